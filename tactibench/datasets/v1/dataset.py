"""Reading a data set."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts
from tactibench.datasets.v1.cache import ImageCache
from tactibench.datasets.v1.content import Content, read_content
from tactibench.datasets.v1.header import Header
from tactibench.datasets.v1.images import read_image
from tactibench.datasets.v1.layout import EVENTS, JOURNAL, LOCK, PLAN, is_reference
from tactibench.datasets.v1.lock import Lock
from tactibench.datasets.v1.plan import read_plan
from tactibench.datasets.v1.repair import needs_repair
from tactibench.datasets.v1.repair import repair as mend
from tactibench.datasets.v1.sample import Sample, contacts_of
from tactibench.datasets.v1.splits import Split, check_split, read_split, split_files
from tactibench.errors import UserError


@dataclass(frozen=True, eq=False)
class Dataset:
    """A data set on the disk. repaired: what opening mended, in sentences."""

    folder: Path
    content: Content = field(repr=False)
    repaired: tuple[str, ...] = ()

    @property
    def header(self) -> Header:
        return self.content.header

    @property
    def samples(self) -> tuple[Sample, ...]:
        """In the order they were written, bad ones included."""
        return self.content.samples

    @property
    def events(self) -> tuple[Mapping[str, Any], ...]:
        return self.content.events

    @property
    def sha256(self) -> str:
        """Identity of labels and images: of the journal, which holds every image's."""
        return self.content.journal_sha256

    @cached_property
    def rest(self) -> npt.NDArray[np.uint8] | None:
        """(H, W) or (H, W, 3) of the undeformed sensor, None when it was not recorded."""
        for number, event in enumerate(self.events, start=1):
            if event.get("kind") == "reference":
                where = f"{self.folder / EVENTS} line {number}"
                name, sha256 = reference_of(event, where)
                image = read_image(self.folder, name, sha256, self.header, where)
                image.setflags(write=False)
                return image
        return None

    @cached_property
    def splits(self) -> Mapping[str, Split]:
        """Name -> split. Raises UserError for one that leaks or is damaged."""
        found = {}
        for name, path in split_files(self.folder).items():
            found[name] = read_split(path)
            check_split(found[name], self.samples, str(path))
        return found

    def plan(self) -> tuple[Mapping[str, Any], ...]:
        """The rows of plan.jsonl. Raises UserError when they were changed."""
        return read_plan(self.folder / PLAN, self.header.plan_sha256)

    def contacts(self, sample: Sample) -> Contacts | None:
        """Of the sample's scene on the header's dome; None where one of them is not known."""
        return contacts_of(sample.scene, self.header.dome_radius_mm)

    def image(self, sample: Sample) -> npt.NDArray[np.uint8]:
        """(H, W) or RGB (H, W, 3) of one sample, decoded. Raises UserError when its file is not
        what it was when it was written; the sentence names file and line."""
        return read_image(
            self.folder, sample.file_name, sample.sha256, self.header, self._where(sample)
        )

    def images(self, samples: Sequence[Sample], size: int | None = None) -> npt.NDArray[np.uint8]:
        """(N, H, W) uint8 gray images, or (N, size, size), from a memory map that is made of all
        images the first time. Raises UserError as ``image`` does."""
        cache = self._caches.setdefault(size, ImageCache(self, size))
        return cache.take([self._row[sample.id] for sample in samples])

    @cached_property
    def _caches(self) -> dict[int | None, ImageCache]:
        return {}

    @cached_property
    def _row(self) -> dict[int, int]:
        return {sample.id: row for row, sample in enumerate(self.samples)}

    def _where(self, sample: Sample) -> str:
        return f"{JOURNAL} line {self._row[sample.id] + 1}"


def open_dataset(folder: Path, repair: bool = True) -> Dataset:
    """Open a data set for reading.

    repair: mend what an interrupted writer left, unless one is at work or the folder cannot be
    written; what was acknowledged is never touched. Raises UserError for what is damaged.
    """
    content = read_content(folder)
    torn = content.header.status == "open" and needs_repair(folder, content)
    mended = _repaired(folder) if repair and torn and os.access(folder, os.W_OK) else None
    return mended or Dataset(folder, content)


def _repaired(folder: Path) -> Dataset | None:
    """The data set, mended; None when that must be left to others or is not possible."""
    try:
        lock = Lock(folder / LOCK)
    except (UserError, OSError):
        return None
    try:
        content = read_content(folder)
        sentences = mend(folder, content)
        return Dataset(folder, content, sentences)
    finally:
        lock.release()


def reference_of(event: Mapping[str, Any], where: str) -> tuple[str, str]:
    """File name and sha256 of a reference frame. Raises UserError for an event without them."""
    name, sha256 = event.get("file_name"), event.get("sha256")
    if not isinstance(name, str) or not isinstance(sha256, str) or not is_reference(name):
        raise UserError(f"{where} names no reference frame; restore the line.")
    return name, sha256
