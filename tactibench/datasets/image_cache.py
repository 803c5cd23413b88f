"""All images of a data set as one uint8 array on the disk: decoded once, then read at will.

The file is derived. Its key holds the hash of the journal, and with it every image's, the size and
how images are made gray and shrunk; it is made again when any of these changes.
"""

from __future__ import annotations

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

from tactibench.datasets.schema import CACHE
from tactibench.errors import UserError
from tactibench.images import gray, resized
from tactibench.records.cache import cache_folder
from tactibench.records.files import file_hash, locked, read_json, write_json
from tactibench.records.identity import digest

Image = npt.NDArray[np.uint8]

_PREPROCESSING = "gray BT.601, area"
_THREADS = os.cpu_count() or 1
_BLOCK = 64
"""Images that a thread decodes at a time."""


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
        """Give the array's file, which nobody else makes meanwhile.

        It lies in the data set, or in the user's cache where the data set is read-only.
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
    """Return whether an array is what it was when it was made."""
    return _is_complete(path, {"sha256": file_hash(path)})


def _is_complete(path: Path, key: dict[str, Any]) -> bool:
    """Return whether an array is there and has these keys; its description is written last."""
    try:
        description = read_json(path.with_suffix(".json"))
        there = path.is_file()
    except (UserError, OSError):
        return False
    return there and (not key or key.items() <= description.items())


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe.{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError:
        return False
    return True
