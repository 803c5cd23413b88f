"""All images of a data set as one uint8 array on the disk: decoded once, then read at will.

The file is derived: its key holds the journal, and with it every image's sha256, the size and how
images are made gray and shrunk. It is made again when anything of that changes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactibench.datasets.v1.layout import CACHE
from tactibench.errors import UserError
from tactibench.images import gray, resized
from tactibench.records.cache import cache_folder
from tactibench.records.files import file_hash, read_json, write_json
from tactibench.records.identity import digest
from tactibench.records.locks import locked

if TYPE_CHECKING:
    from tactibench.datasets.v1.dataset import Dataset

_PREPROCESSING = "gray BT.601, area"
_THREADS = os.cpu_count() or 1
_BLOCK = 64
"""Images that a thread decodes at a time."""


@dataclass(frozen=True, eq=False)
class ImageCache:
    """The images of a data set, gray, at their own size or (size, size)."""

    dataset: Dataset
    size: int | None

    def take(self, rows: Sequence[int]) -> npt.NDArray[np.uint8]:
        """(N, H, W) of rows of the journal."""
        index = np.asarray(rows, dtype=np.intp)
        taken: npt.NDArray[np.uint8] = self._map[index]
        return taken

    @property
    def shape(self) -> tuple[int, int, int]:
        height, width = (self.size, self.size) if self.size else self.dataset.header.image
        return len(self.dataset.samples), height, width

    @cached_property
    def _map(self) -> npt.NDArray[np.uint8]:
        key = {
            "journal_sha256": self.dataset.sha256,
            "shape": list(self.shape),
            "preprocessing": _PREPROCESSING,
        }
        name = digest(key)[:24]
        with self._place(name) as path:
            if not _whole(path, key):
                self._make(path)
                write_json(path.with_suffix(".json"), {**key, "sha256": file_hash(path)})
                self._forget_older(path)
            if not self.shape[0]:
                return np.empty(self.shape, np.uint8)
            mapped: npt.NDArray[np.uint8] = np.load(path, mmap_mode="r")
            # A plain array over the same pages: indexing it is several times faster.
            return mapped.view(np.ndarray)

    @contextmanager
    def _place(self, name: str) -> Iterator[Path]:
        """Where the array is kept: in the data set, or in the user's cache where that is
        read-only. Nobody else makes it meanwhile."""
        for folder in (self.dataset.folder / CACHE, cache_folder() / "datasets"):
            path = folder / f"{name}.npy"
            if _whole(path, None):
                yield path
                return
            if _writable(folder):
                with locked(folder / ".lock"):
                    yield path
                return
        raise UserError(
            f"neither {self.dataset.folder / CACHE} nor {folder} can be written; name a folder "
            "for the cache with TACTIBENCH_CACHE."
        )

    def _make(self, path: Path) -> None:
        """Decode every image into the array."""
        part = path.with_name(f".{path.name}.{os.getpid()}")
        count = self.shape[0]
        try:
            if count:
                array = np.lib.format.open_memmap(part, "w+", np.dtype(np.uint8), self.shape)
                self._fill(array)
                array.flush()
                part.replace(path)
            else:
                path.touch()
        finally:
            part.unlink(missing_ok=True)

    def _fill(self, array: npt.NDArray[np.uint8]) -> None:
        samples = self.dataset.samples
        target = self.shape[1:]

        def fill(start: int) -> None:
            for row in range(start, min(start + _BLOCK, len(samples))):
                array[row] = resized(gray(self.dataset.image(samples[row])), target)

        with ThreadPoolExecutor(_THREADS) as pool:  # hashing and decoding release the GIL
            blocks = [pool.submit(fill, start) for start in range(0, len(samples), _BLOCK)]
            try:
                for block in blocks:
                    block.result()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise

    def _forget_older(self, path: Path) -> None:
        """Remove arrays of this data set as it was before samples were added."""
        if path.parent != self.dataset.folder / CACHE:
            return
        for other in path.parent.glob("*.json"):
            if not _whole(other.with_suffix(".npy"), {"journal_sha256": self.dataset.sha256}):
                for suffix in (".json", ".npy"):
                    other.with_suffix(suffix).unlink(missing_ok=True)


def is_intact(path: Path) -> bool:
    """Whether an array is what it was when it was made."""
    return _whole(path, {"sha256": file_hash(path)})


def _whole(path: Path, key: dict[str, Any] | None) -> bool:
    """Whether an array is there, with these keys: its description is written last."""
    try:
        found = read_json(path.with_suffix(".json"))
        there = path.is_file()
    except (UserError, OSError):
        return False
    return there and (key is None or key.items() <= found.items())


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe.{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError:
        return False
    return True
