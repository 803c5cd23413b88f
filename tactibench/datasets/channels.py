"""Channels of a data set whose sensor is no camera: one file with one row per sample.

channels.f32 holds, for every line of the journal in its order, the sample's channels as
little-endian float32. Rows are only ever added, and before the line that holds their sha256, so
that a crash leaves rows that no line acknowledges and never a line without its row. Any program
reads it: ``numpy.fromfile("channels.f32", "<f4").reshape(-1, *shape)``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError

CHANNEL_FILE = "channels.f32"

Channels = npt.NDArray[np.float32]


@dataclass(frozen=True)
class ChannelKind:
    """Shape of every sample's channels: (C,), or (rows, columns) of an array of taxels."""

    shape: tuple[int, ...]

    def __str__(self) -> str:
        return f"{'x'.join(map(str, self.shape))} channels"

    @property
    def row_bytes(self) -> int:
        """Bytes of a sample."""
        return 4 * prod(self.shape)


def channel_bytes(signal: Any, kind: ChannelKind, what: str) -> bytes:
    """Return the bytes of a sample's row.

    Args:
        signal: The channels, of the shape of ``kind``.
        kind: Shape of the data set's channels.
        what: Words for the sample, for errors.

    Raises:
        UserError: The channels have another shape than those of the data set, or are not finite.
    """
    array = np.asarray(signal)
    if array.dtype.kind not in "fiu" or array.shape != kind.shape:
        raise UserError(
            f"{what} has the shape {array.shape} and type {array.dtype}, but this data set holds "
            f"{kind} of float32."
        )
    with np.errstate(over="ignore"):  # becomes infinite, which is refused
        row = array.astype("<f4")
    if not np.isfinite(row).all():
        raise UserError(f"{what} holds a channel that is no finite number; leave the sample out.")
    return row.tobytes()


def read_channels(folder: Path, row: int, sha256: str, kind: ChannelKind, where: str) -> Channels:
    """Return the channels of a row.

    Args:
        folder: The data set's folder.
        row: Number of the line in the journal, from 0.
        sha256: Hash that the row must have.
        kind: Shape of the row.
        where: The line, for errors.

    Raises:
        UserError: The file cannot be read, or the row is not the one that was written.
    """
    path = folder / CHANNEL_FILE
    try:
        with path.open("rb") as file:
            file.seek(row * kind.row_bytes)
            data = file.read(kind.row_bytes)
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None
    if hashlib.sha256(data).hexdigest() != sha256:
        raise UserError(
            f"{path} row {row + 1} was changed after it was written (checksum, {where}); restore "
            "the file from a copy."
        )
    return np.frombuffer(data, "<f4").astype(np.float32).reshape(kind.shape)


def reference_channels(event: Mapping[str, Any], kind: ChannelKind, where: str) -> Channels:
    """Return the channels at rest that an event of the journal holds.

    Raises:
        UserError: The channels are missing, or not those that were written.
    """
    try:
        row = channel_bytes(np.array(event["channels"], dtype=np.float32), kind, where)
    except (KeyError, TypeError, ValueError):
        row = b""
    if hashlib.sha256(row).hexdigest() != event.get("sha256"):
        raise UserError(f"{where} does not hold the channels at rest; restore the line.")
    return np.frombuffer(row, "<f4").astype(np.float32).reshape(kind.shape)


def unacknowledged_bytes(folder: Path, kind: ChannelKind, lines: int) -> bytes:
    """Return the bytes behind the rows that the journal's ``lines`` lines name."""
    path = folder / CHANNEL_FILE
    if not path.exists():
        return b""
    with path.open("rb") as file:
        file.seek(lines * kind.row_bytes)
        return file.read()
