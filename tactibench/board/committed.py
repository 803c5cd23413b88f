"""Answers beside a committed record: ``<name>.npz``, lossless, and what is read of it.

It holds the packed answers as they were stored, and under ``ranked.`` the error that orders the
board, press by press, so that a board ranks its rows without making any truth again. ``tactibench
verify`` computes both anew. Files of strangers are read too: sizes are looked up before anything is
unpacked.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics.compare import press_means
from tactibench.metrics.trials import PlateTrials, Trials
from tactibench.protocols.board_spec import board_spec
from tactibench.protocols.schema import Protocol
from tactibench.records.files import read_arrays
from tactibench.run.score import trials_of

Arrays = dict[str, npt.NDArray[Any]]

RANKED = "ranked."
LARGEST = 64 * 2**20
"""Bytes of all arrays of a file, unpacked; exp3 needs a third of a megabyte."""


@dataclass(frozen=True, eq=False)
class PressErrors:
    """The error that orders a board. press: (P,) names, sorted. error: (P,) mean of each press."""

    press: npt.NDArray[Any]
    error: FloatArray


def answers_file(record_file: Path) -> Path:
    """Where the answers of a committed record lie."""
    return record_file.with_suffix(".npz")


def ranked_errors(
    keys: Protocol, truth: Mapping[str, npt.NDArray[Any]], predicted: Arrays
) -> Arrays:
    """Arrays of the error that orders the board; empty where none does."""
    if board_spec(keys.id).ranking is None:
        return {}
    found = press_errors_of(keys, trials_of(keys, truth, predicted))
    return {f"{RANKED}press": found.press, f"{RANKED}error": found.error}


def press_errors_of(keys: Protocol, trials: Trials | PlateTrials) -> PressErrors:
    """The error that orders the board of a protocol, which has one."""
    by = board_spec(keys.id).ranking
    if by is None:
        raise UserError(f"no error orders the board of {keys.id}, so it ranks nothing.")
    group = by.group if keys.answer == "plate" else "all"  # elsewhere it is an axis, or all
    error = press_means(by.metric, trials, (group,))[:, 0]
    known = np.isfinite(error)
    return PressErrors(np.unique(trials.press)[known], error[known])


def split_ranked(arrays: Arrays) -> tuple[Arrays, Arrays]:
    """Packed answers, and what stands under ``ranked.``."""
    ranked = {name: array for name, array in arrays.items() if name.startswith(RANKED)}
    return {name: array for name, array in arrays.items() if name not in ranked}, ranked


def read_answers_file(path: Path) -> Arrays:
    """All arrays. Raises UserError for a file that is missing, damaged or too large."""
    _refuse_large(path)
    return read_arrays(path)


def read_press_errors(path: Path) -> PressErrors | None:
    """What a board ranks by; None where there are no answers beside the record, or no order.

    Raises UserError for a damaged file.
    """
    if not path.is_file():
        return None
    _refuse_large(path)
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            press, errors = file[f"{RANKED}press"], file[f"{RANKED}error"].astype(np.float64)
    except KeyError:
        return None
    except Exception as error:  # noqa: BLE001 - zip, zlib, header and value errors alike
        raise UserError(
            f"{path} is damaged ({type(error).__name__}); submit the run again."
        ) from None
    if press.shape != errors.shape or errors.ndim != 1 or not np.isfinite(errors).all():
        raise UserError(f"{path} does not hold one finite error a press; submit the run again.")
    return PressErrors(press, errors)


def _refuse_large(path: Path) -> None:
    """Raise UserError unless the file is an archive whose arrays fit in LARGEST bytes.

    Both the sizes in the archive's directory and the shapes in the arrays' headers are looked at:
    either would have memory allocated for it.
    """
    if path.is_symlink() or not path.is_file():
        raise UserError(f"{path} is missing: the answers belong beside the record.")
    try:
        with zipfile.ZipFile(path) as archive:
            total = sum(member.file_size for member in archive.infolist())
            claimed = 0
            for member in archive.infolist():
                if total <= LARGEST:
                    claimed += _claimed(archive, member)
    except (OSError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        # RuntimeError: encrypted, or compressed in a way that zipfile does not know.
        raise UserError(f"{path} is no archive of arrays ({type(error).__name__}).") from None
    if max(total, claimed) > LARGEST:
        raise UserError(
            f"{path} holds {max(total, claimed):,} bytes of arrays, more than the "
            f"{LARGEST:,} that answers may take; submit the answers to the test frames alone."
        )


def _claimed(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> int:
    """Bytes that an array's header asks for. Raises ValueError for one that is no array."""
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        read = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }.get(version)
        if read is None:
            raise ValueError(f"array format {version}")
        shape, _, dtype = read(stream)
    count = 1
    for length in shape:
        count *= length
    return count * dtype.itemsize
