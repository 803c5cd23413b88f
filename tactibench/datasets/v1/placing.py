"""Putting images where they belong: written under temporary names, synced, then renamed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tactibench.datasets.v1.durable import make_folder, sync_file, sync_folder, write_new
from tactibench.datasets.v1.header import Header
from tactibench.datasets.v1.images import png_of
from tactibench.datasets.v1.layout import UNFINISHED, image_name
from tactibench.datasets.v1.sample import Draft

_WAITING = 16
"""Threads that wait for the disk at once: it then writes their files in one go."""


class ImagePlacer:
    """Writes the images of drafts. fsync: wait for the disk before files get their names.

    One thread encodes and writes: several would wait for each other rather than for the disk.
    """

    def __init__(self, folder: Path, header: Header, *, fsync: bool) -> None:
        self._folder, self._header, self._fsync = folder, header, fsync
        self._pool = ThreadPoolExecutor(_WAITING, thread_name_prefix="placer")

    def write(self, drafts: Sequence[Draft]) -> list[str]:
        """sha256 of every image's file, which is there under a temporary name.

        Raises UserError for an image that is not like the data set's.
        """
        for folder in {Path(place).parent for place in map(self._place, drafts)}:
            make_folder(folder)
        hashes = [self._write(draft) for draft in drafts]
        if self._fsync:
            parts = [self._part(draft) for draft in drafts]
            if len(parts) == 1:
                sync_file(parts[0])
            shares = [parts[first::_WAITING] for first in range(_WAITING)] if parts[1:] else []
            for _ in self._pool.map(_sync_files, shares):
                pass  # an error of a thread is raised here
        return hashes

    def rename(self, drafts: Sequence[Draft]) -> None:
        """Give the files their names, durably."""
        for draft in drafts:
            os.replace(self._part(draft), self._place(draft))  # noqa: PTH105 - twice as fast
        if self._fsync:
            for folder in {Path(place).parent for place in map(self._place, drafts)}:
                sync_folder(folder)

    def forget(self, drafts: Sequence[Draft]) -> None:
        """Remove what was written under temporary names."""
        for draft in drafts:
            Path(self._part(draft)).unlink(missing_ok=True)

    def close(self) -> None:
        self._pool.shutdown()

    def _write(self, draft: Draft) -> str:
        data = png_of(draft.image, self._header, f"the image of sample {draft.id}")
        write_new(self._part(draft), data)
        return hashlib.sha256(data).hexdigest()

    def _place(self, draft: Draft) -> str:
        return f"{self._folder}/{image_name(draft.id)}"

    def _part(self, draft: Draft) -> str:
        folder, _, name = self._place(draft).rpartition("/")
        return f"{folder}/.{name}{UNFINISHED}"


def _sync_files(paths: Sequence[str]) -> None:
    for path in paths:
        sync_file(path)
