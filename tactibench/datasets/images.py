"""Images of a data set: checked files, durable when written, and one array of all of them.

The array is derived: it is decoded once and can then be read in any order. Its key holds the hash
of the journal, and with it that of every image, the size, and the way in which images are made gray
and shrunk. It is made again when any of these changes.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Signal
from tactibench.datasets.channels import ChannelKind, channel_bytes
from tactibench.datasets.journal import UNFINISHED
from tactibench.datasets.schema import CACHE
from tactibench.datasets.storage import make_folder, sync_file, sync_folder
from tactibench.errors import UserError
from tactibench.images import gray, resized
from tactibench.png import ImageKind, check_png, decode_png, encode_png, read_file
from tactibench.records import cache_folder, digest, file_hash, locked, read_json, write_json

Image = npt.NDArray[np.uint8]

_SYNC_THREADS = 16
"""Threads that wait for the disk at once, so that it writes their files together."""
_PLAIN_PNG = (b"\x08\x00", b"\x08\x02")
"""Bits and colour type, at bytes 24 and 25 of a PNG: 8-bit gray and 8-bit RGB."""


_PREPROCESSING = "gray BT.601, area"
_THREADS = os.cpu_count() or 1
_BLOCK = 64
"""Images that a thread decodes at a time."""


def is_plain_png(data: bytes) -> bool:
    """Return whether a PNG can be copied into a data set: 8-bit gray or RGB, no alpha."""
    return data[24:26] in _PLAIN_PNG


def signal_bytes(signal: Signal | bytes, kind: ImageKind | ChannelKind, what: str) -> bytes:
    """Return what a data set stores of a sample: the PNG file of an image, or a row of channels.

    Bytes are stored as they are.

    Args:
        signal: The image, the bytes of its PNG file, the channels, or the bytes of their row.
        kind: Kind of the data set's images or channels.
        what: Words for the sample, for errors.

    Raises:
        UserError: The signal differs in shape or type from those of the data set, is a PNG that a
            data set cannot hold, or is not finite.
    """
    if isinstance(kind, ImageKind):
        return png_bytes(signal, kind, what)
    return signal if isinstance(signal, bytes) else channel_bytes(signal, kind, what)


def png_bytes(image: Signal | bytes, kind: ImageKind, what: str) -> bytes:
    """Return the PNG file of an image; the bytes of a PNG are returned as they are.

    Args:
        image: The image, or the bytes of its PNG file.
        kind: Size and colours of the data set's images.
        what: Words for the image, for errors.

    Raises:
        UserError: The image differs in size, colours or type from those of the data set, or its PNG
            is damaged or not 8-bit gray or RGB.
    """
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


def read_image(folder: Path, name: str, sha256: str, kind: ImageKind, where: str) -> Image:
    """Return an image of the data set, (H, W) or (H, W, 3) uint8.

    Args:
        folder: The data set's folder.
        name: The image's file, relative to the folder.
        sha256: Hash that the file must have.
        kind: Size and colours of the image.
        where: The line that names the file, for errors.

    Raises:
        UserError: The file is not the one that was written.
    """
    path = folder / name
    data = read_file(path)
    if hashlib.sha256(data).hexdigest() != sha256:
        raise UserError(f"{_damage(path, data)} ({where}); restore it from a copy.")
    return decode_png(f"{path} ({where})", data, kind)


def _damage(path: Path, data: bytes) -> str:
    """Return in words how a file differs from the one that was written."""
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
        names: Final names of the images, relative to the folder.
        files: Bytes of the PNG files.
        fsync: Whether to wait for the disk.
    """
    for place in _folders(folder, names):
        make_folder(place)
    paths = [_temporary(folder, name) for name in names]
    for path, data in zip(paths, files, strict=True):
        write_file(path, data)
    if fsync:
        with ThreadPoolExecutor(_SYNC_THREADS) as pool:
            for _ in pool.map(sync_file, paths):
                pass  # an error of a thread is raised here


def write_file(path: Path, data: bytes) -> None:
    """Write one file; tests of a full disk replace this function."""
    path.write_bytes(data)


def rename_images(folder: Path, names: Sequence[str], *, fsync: bool) -> None:
    """Give written images their names; with ``fsync`` the names are durable."""
    for name in names:
        os.replace(_temporary(folder, name), folder / name)  # noqa: PTH105 - a test counts it
    if fsync:
        for place in _folders(folder, names):
            sync_folder(place)


def discard_images(folder: Path, names: Sequence[str]) -> None:
    """Remove the images that were written under temporary names."""
    for name in names:
        _temporary(folder, name).unlink(missing_ok=True)


def _folders(folder: Path, names: Sequence[str]) -> set[Path]:
    return {(folder / name).parent for name in names}


def _temporary(folder: Path, name: str) -> Path:
    path = folder / name
    return path.with_name(f".{path.name}{UNFINISHED}")


@dataclass(frozen=True, eq=False)
class ImageCache:
    """The images of a data set, gray, in one size.

    Attributes:
        folder: The data set's folder.
        sha256: Hash of the data set's journal.
        shape: Number, height and width of the images.
        read: Row of the journal -> image, (H, W) or (H, W, 3) uint8, of any size.
    """

    folder: Path
    sha256: str
    shape: tuple[int, int, int]
    read: Callable[[int], Image]

    def take(self, rows: Sequence[int]) -> Image:
        """Return the images of rows of the journal, (N, H, W)."""
        images: Image = self._map[np.asarray(rows, dtype=np.intp)]
        return images

    @cached_property
    def _map(self) -> Image:
        key = {
            "journal_sha256": self.sha256,
            "shape": list(self.shape),
            "preprocessing": _PREPROCESSING,
        }
        with self._reserve(digest(key)[:24]) as path:
            if not _is_complete(path, key):
                self._make(path)
                write_json(path.with_suffix(".json"), {**key, "sha256": file_hash(path)})
                self._remove_older(path)
            if not self.shape[0]:
                return np.empty(self.shape, np.uint8)
            mapped: Image = np.load(path, mmap_mode="r")
            # A plain array over the same pages: indexing it is several times faster.
            return mapped.view(np.ndarray)

    @contextmanager
    def _reserve(self, name: str) -> Iterator[Path]:
        """Yield the array's file, which no other process makes meanwhile.

        It lies in the data set, or in the user's cache where the data set is read-only.

        Raises:
            UserError: Neither of the two folders can be written.
        """
        for folder in (self.folder / CACHE, cache_folder() / "datasets"):
            path = folder / f"{name}.npy"
            if _is_complete(path, {}):
                yield path
                return
            if _is_writable(folder):
                with locked(folder / ".lock"):
                    yield path
                return
        raise UserError(
            f"neither {self.folder / CACHE} nor {folder} can be written; name a folder "
            "for the cache with TACTIBENCH_CACHE."
        )

    def _make(self, path: Path) -> None:
        temporary = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            if self.shape[0]:
                array = np.lib.format.open_memmap(temporary, "w+", np.dtype(np.uint8), self.shape)
                self._fill(array)
                array.flush()
                temporary.replace(path)
            else:
                path.touch()
        finally:
            temporary.unlink(missing_ok=True)

    def _fill(self, array: Image) -> None:
        count, height, width = self.shape

        def fill(start: int) -> None:
            for row in range(start, min(start + _BLOCK, count)):
                array[row] = resized(gray(self.read(row)), (height, width))

        with ThreadPoolExecutor(_THREADS) as pool:  # hashing and decoding release the GIL
            blocks = [pool.submit(fill, start) for start in range(0, count, _BLOCK)]
            try:
                for block in blocks:
                    block.result()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise

    def _remove_older(self, path: Path) -> None:
        """Remove arrays of this data set as it was before samples were added."""
        if path.parent != self.folder / CACHE:
            return
        for other in path.parent.glob("*.json"):
            if not _is_complete(other.with_suffix(".npy"), {"journal_sha256": self.sha256}):
                for suffix in (".json", ".npy"):
                    other.with_suffix(suffix).unlink(missing_ok=True)


def is_intact(path: Path) -> bool:
    """Return whether an array was not changed since it was made."""
    return _is_complete(path, {"sha256": file_hash(path)})


def _is_complete(path: Path, key: dict[str, Any]) -> bool:
    """Return whether an array exists and has these keys; its description is written last."""
    try:
        description = read_json(path.with_suffix(".json"))
        exists = path.is_file()
    except (UserError, OSError):
        return False
    return exists and (not key or key.items() <= description.items())


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe.{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError:
        return False
    return True
