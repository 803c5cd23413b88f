"""Image files of a data set: checked when they are read, durable when they are written."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.datasets.journal import UNFINISHED
from tactibench.datasets.schema import Header
from tactibench.datasets.storage import make_folder, sync_file, sync_folder
from tactibench.errors import UserError
from tactibench.png import ImageKind, check_png, decode_png, encode_png, read_file

Image = npt.NDArray[np.uint8]

_SYNC_THREADS = 16
"""Threads that wait for the disk at once: it then writes their files in one go."""
_PLAIN_PNG = (b"\x08\x00", b"\x08\x02")
"""Bits and colour type, at bytes 24 and 25 of a PNG: 8-bit gray and 8-bit RGB."""


def kind_of(header: Header) -> ImageKind:
    """Return the size and colours that every image of a data set has."""
    return ImageKind(*header.image, header.channels == 3)


def is_plain_png(data: bytes) -> bool:
    """Return whether a PNG can be copied into a data set: 8-bit gray or RGB, no alpha."""
    return data[24:26] in _PLAIN_PNG


def png_bytes(image: Image | bytes, header: Header, what: str) -> bytes:
    """Return the PNG file of an image; the bytes of a PNG are taken as they are.

    Args:
        image: (H, W) or (H, W, 3) uint8, or a PNG file.
        header: Header of the data set.
        what: Name of the image, the beginning of an error's sentence.

    Raises:
        UserError: The image is not like the data set's others.
    """
    kind = kind_of(header)
    if isinstance(image, bytes):
        if check_png(what, image) != kind or not is_plain_png(image):
            raise UserError(f"{what} is not an 8-bit {kind} PNG without alpha; decode it first.")
        decode_png(what, image, kind)
        return image
    array: npt.NDArray[Any] = np.asarray(image)
    if array.dtype != np.uint8 or array.shape != kind.shape:
        raise UserError(
            f"{what} has the shape {array.shape} and type {array.dtype}, but this data set holds "
            f"{kind.shape} and uint8."
        )
    return encode_png(array)


def read_image(folder: Path, name: str, sha256: str, header: Header, where: str) -> Image:
    """Return an image of the data set, (H, W) or (H, W, 3) uint8.

    Args:
        folder: The data set's folder.
        name: The image's file, relative to the folder.
        sha256: Hash that the file must have.
        header: Header of the data set.
        where: The line that names the file, for errors.

    Raises:
        UserError: The file is not the one that was written.
    """
    path = folder / name
    data = read_file(path)
    if hashlib.sha256(data).hexdigest() != sha256:
        raise UserError(f"{_damage(path, data)} ({where}); restore it from a copy.")
    return decode_png(f"{path} ({where})", data, kind_of(header))


def _damage(path: Path, data: bytes) -> str:
    """Say how a file differs from the one that was written."""
    try:
        check_png(path, data)
    except UserError as error:
        return str(error).partition(";")[0]
    return f"{path} was changed after it was written (checksum)"


def write_images(
    folder: Path, names: Sequence[str], files: Sequence[bytes], *, fsync: bool
) -> None:
    """Write images under temporary names, and wait until the disk has them.

    One thread writes: several would wait for each other rather than for the disk.

    Args:
        folder: The data set's folder.
        names: Names of the images, relative to the folder.
        files: Bytes of the PNG files.
        fsync: Whether to wait for the disk.
    """
    for place in _folders(folder, names):
        make_folder(place)
    paths = [_temporary(folder, name) for name in names]
    for path, data in zip(paths, files, strict=True):
        path.write_bytes(data)
    if fsync:
        with ThreadPoolExecutor(_SYNC_THREADS) as pool:
            for _ in pool.map(sync_file, paths):
                pass  # an error of a thread is raised here


def rename_images(folder: Path, names: Sequence[str], *, fsync: bool) -> None:
    """Give written images their names; with ``fsync`` the names are durable."""
    for name in names:
        os.replace(_temporary(folder, name), folder / name)  # noqa: PTH105 - a test counts it
    if fsync:
        for place in _folders(folder, names):
            sync_folder(place)


def discard_images(folder: Path, names: Sequence[str]) -> None:
    """Remove what was written under temporary names."""
    for name in names:
        _temporary(folder, name).unlink(missing_ok=True)


def _folders(folder: Path, names: Sequence[str]) -> set[Path]:
    return {(folder / name).parent for name in names}


def _temporary(folder: Path, name: str) -> Path:
    path = folder / name
    return path.with_name(f".{path.name}{UNFINISHED}")
