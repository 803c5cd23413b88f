"""A data set that is opened for reading."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, cast

from tactibench.contacts import Contacts, Signal
from tactibench.datasets.channels import ChannelKind, read_channels, reference_channels
from tactibench.datasets.checksums import refuse_changed
from tactibench.datasets.images import Image, ImageCache, read_image
from tactibench.datasets.index import JournalIndex
from tactibench.datasets.journal import (
    Content,
    Event,
    needs_repair,
    read_content,
    reference_file,
    repair,
)
from tactibench.datasets.rows import read_plan
from tactibench.datasets.schema import EVENTS, JOURNAL, LOCK, PLAN, Header, Sample, contacts_of
from tactibench.datasets.splits import Split, check_split, read_split, split_files
from tactibench.datasets.storage import WriterLock
from tactibench.errors import UserError
from tactibench.png import ImageKind, read_file


@dataclass(frozen=True, eq=False)
class Dataset:
    """A data set on the disk.

    Attributes:
        folder: The data set's folder.
        header: Facts that hold for every sample.
        samples: Samples in the order they were written, bad ones included.
        events: Events in the order they were noted.
        sha256: Identity of labels and images: the hash of the journal, which holds every image's.
        index: Lines of the journal by row and id.
        repaired: One sentence for each thing that opening repaired.
    """

    folder: Path
    header: Header
    samples: Sequence[Sample] = field(repr=False)
    events: tuple[Event, ...] = field(repr=False)
    sha256: str
    index: JournalIndex = field(repr=False)
    repaired: tuple[str, ...] = ()

    @classmethod
    def of_content(cls, folder: Path, content: Content, repaired: tuple[str, ...] = ()) -> Dataset:
        """Return the data set of a folder from its content."""
        return cls(
            folder,
            content.header,
            content.samples,
            content.events,
            content.journal.sha256,
            content.journal,
            repaired,
        )

    @cached_property
    def rest(self) -> Signal | None:
        """Signal of the undeformed sensor, like that of a sample; None if it was not recorded."""
        for number, event in enumerate(self.events, start=1):
            if event.get("kind") == "reference":
                where = f"{self.folder / EVENTS} line {number}"
                kind = self.header.kind
                if isinstance(kind, ChannelKind):
                    return reference_channels(event, kind, where)
                name, sha256 = reference_file(event, where)
                image = read_image(self.folder, name, sha256, kind, where)
                image.setflags(write=False)
                return image
        return None

    @property
    def rest_image(self) -> Image | None:
        """Image of the undeformed sensor, if there is one.

        Raises:
            UserError: The samples hold channels.
        """
        self._image_kind()
        return cast("Image | None", self.rest)

    @cached_property
    def splits(self) -> Mapping[str, Split]:
        """Name -> split.

        Raises:
            UserError: A split has a press in two subsets, names an id that is no sample, or is
                damaged.
        """
        splits = {}
        for name, path in split_files(self.folder).items():
            if self.header.status == "closed":
                refuse_changed(self.folder, path.relative_to(self.folder).as_posix())
            splits[name] = read_split(path)
            check_split(splits[name], self.samples, str(path))
        return splits

    def plan(self) -> tuple[Mapping[str, Any], ...]:
        """Return the rows of plan.jsonl.

        Raises:
            UserError: The plan was changed or is damaged.
        """
        return read_plan(self.folder / PLAN, self.header.plan_sha256)

    def contacts(self, sample: Sample) -> Contacts | None:
        """Return the contacts of a sample on the header's dome; None where one is unknown."""
        return contacts_of(sample.scene, self.header.dome_radius_mm)

    def signal(self, sample: Sample) -> Signal:
        """Return the signal of a sample: its image, or channels of the header's shape, float32.

        Raises:
            UserError: The file is not what was written; the sentence names file and line.
        """
        kind, row = self.header.kind, self.index.row_of(sample.id)
        if isinstance(kind, ImageKind):
            return self.image(sample)
        return read_channels(self.folder, row, sample.sha256, kind, f"{JOURNAL} line {row + 1}")

    def image(self, sample: Sample) -> Image:
        """Return the image of a sample, (H, W) or RGB (H, W, 3) uint8.

        Raises:
            UserError: The file is not what was written; the sentence names file and line. Or the
                samples hold channels and no images.
        """
        where = f"{JOURNAL} line {self.index.row_of(sample.id) + 1}"
        return read_image(self.folder, sample.file_name, sample.sha256, self._image_kind(), where)

    def image_file(self, sample: Sample) -> bytes:
        """Return the PNG file of a sample's image, which is not decoded.

        Raises:
            UserError: The file is not the one that was written, or the samples hold channels.
        """
        self._image_kind()
        path = self.folder / sample.file_name
        data = read_file(path)
        if hashlib.sha256(data).hexdigest() != sample.sha256:
            raise UserError(
                f"{path} is not the file that sample {sample.id} had (its sha256 differs); see "
                f"`tactibench data verify {self.folder}`."
            )
        return data

    def images(self, samples: Sequence[Sample], size: int | None = None) -> Image:
        """Return gray images of samples, (N, H, W) uint8.

        They come from a memory map, which the first call makes of all images.

        Args:
            samples: Samples of this data set, in any order.
            size: Height and width of the images; None keeps their own.

        Raises:
            UserError: An image's file is not what was written, or the samples hold channels.
        """
        kind = self._image_kind()
        height, width = (size, size) if size else (kind.height, kind.width)
        shape = (len(self.samples), height, width)
        cache = self._caches.setdefault(
            shape,
            ImageCache(self.folder, self.sha256, shape, lambda row: self.image(self.samples[row])),
        )
        return cache.take([self.index.row_of(sample.id) for sample in samples])

    def _image_kind(self) -> ImageKind:
        kind = self.header.kind
        if not isinstance(kind, ImageKind):
            raise UserError(
                f"the samples of {self.folder} hold {kind} and no images; take a data set of "
                "images."
            )
        return kind

    @cached_property
    def _caches(self) -> dict[tuple[int, int, int], ImageCache]:
        return {}


def open_dataset(folder: Path, repair: bool = True) -> Dataset:
    """Open a data set for reading.

    Args:
        folder: The data set's folder.
        repair: Whether to repair what an interrupted writer left. Nothing is repaired while a
            writer is at work, or where the folder cannot be written. Acknowledged samples never
            change.

    Raises:
        UserError: The folder holds no data set, or a damaged one.
    """
    content = read_content(folder)
    torn = content.header.status == "open" and needs_repair(folder, content)
    repaired = _repair(folder) if repair and torn and os.access(folder, os.W_OK) else None
    return repaired or Dataset.of_content(folder, content)


def _repair(folder: Path) -> Dataset | None:
    """Return the repaired data set; None where another process writes it or has the lock."""
    try:
        lock = WriterLock(folder / LOCK)
    except (UserError, OSError):
        return None
    try:
        content = read_content(folder)
        return Dataset.of_content(folder, content, repair(folder, content))
    finally:
        lock.release()
