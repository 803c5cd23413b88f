"""A recording of any format: frames on the disk with their labels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Scene, Signal
from tactibench.datasets.channels import ChannelKind
from tactibench.datasets.dataset import Dataset, open_dataset
from tactibench.datasets.images import Image
from tactibench.datasets.schema import IMAGES, JOURNAL, Sample
from tactibench.datasets.splits import Split
from tactibench.errors import UserError
from tactibench.markers import PinView
from tactibench.png import ImageKind, decode_png, read_file

FloatArray = npt.NDArray[np.float64]

SOURCE_NAME = "source_name"
"""Key of a sample's ``extra``: the name of its frame in the folder that was imported."""


@dataclass(frozen=True, eq=False)
class Recording:
    """N frames with their labels; every file was read once and is sound.

    Attributes:
        format: "bristol", "csv", "huggingface" or "v1".
        generation: The variant of the format, in words.
        folder: The folder that was opened.
        table: The file of the labels.
        names: Unique names of the frames, in the order of the table.
        paths: Files of the frames; () where one file holds the channels of all.
        frames: The folder of these files, or the file of all channels.
        stored: Size and colours of every file, or the shape of its channels.
        rest: File of the undeformed frame.
        labels: Column -> (N,) mm or deg, NaN where a frame has no such label.
        scenes: Scene of every frame, None where only labels are known.
        presses: Name of the press of every frame; frames of one press share it.
        sha256: Hash over the table and the frames.
        columns: Role, such as "depth" -> column.
        extra: Other columns -> (N,) texts.
        samples: Fields of every frame's sample that the table holds: id, session, attempt,
            t_frame_ns, extra. Empty where it holds none.
        header: Fields of a data set's header that the folder holds.
        splits: Name -> split of row numbers.
        about: Name of a file beside the table -> its content; of a data set, its source.
        dome_radius_mm: Radius of the pressed surface, inf where it is flat, None if unknown.
        notes: Sentences about facts that were left out or are missing.
        values: (N, ...) float32 channels, of a sensor without a camera.
        signal_names: Names of the channels.
        view: Part of raw pictures that shows the pins; frames are this part of them.
        estimated_rest: The undeformed frame, estimated from frames that were hardly pressed.
        dataset: The data set that was opened; None for other formats.
        rows: Numbers of the data set's samples that are the frames.
    """

    format: str
    generation: str
    folder: Path
    table: Path
    names: tuple[str, ...]
    paths: tuple[Path, ...]
    frames: Path
    stored: ImageKind | ChannelKind
    rest: Path | None
    labels: Mapping[str, FloatArray]
    scenes: tuple[Scene | None, ...]
    presses: tuple[str, ...]
    sha256: str
    columns: Mapping[str, str] = field(default_factory=dict)
    extra: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    samples: tuple[Mapping[str, Any], ...] = ()
    header: Mapping[str, Any] = field(default_factory=dict)
    splits: Mapping[str, Split] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)
    dome_radius_mm: float | None = None
    notes: tuple[str, ...] = ()
    values: npt.NDArray[np.float32] | None = field(default=None, repr=False)
    signal_names: tuple[str, ...] = ()
    view: PinView | None = None
    estimated_rest: Image | None = field(default=None, repr=False)
    dataset: Dataset | None = None
    rows: tuple[int, ...] = ()

    @property
    def kind(self) -> ImageKind | ChannelKind:
        """Size and colours of every frame, or the shape of its channels."""
        if self.view is None:
            return self.stored
        return ImageKind(self.view.size, self.view.size, colour=False)

    @property
    def channels(self) -> Literal[1, 3]:
        """1 for gray, 3 for RGB."""
        return 3 if isinstance(self.kind, ImageKind) and self.kind.colour else 1

    def __len__(self) -> int:
        return len(self.names)

    def signal(self, row: int) -> Signal:
        """Return the signal of a frame: its image, or its channels.

        Raises:
            UserError: The file was changed since the recording was opened.
        """
        if self.dataset is not None:
            return self.dataset.signal(self.dataset.samples[self.rows[row]])
        return self.image(row) if self.values is None else self.values[row]

    def rest_signal(self) -> Signal | None:
        """Return the signal of the undeformed sensor; None where there is none.

        Raises:
            UserError: The file cannot be decoded.
        """
        if self.dataset is not None:
            return self.dataset.rest
        return self.estimated_rest if self.rest is None else self._decode(self.rest)

    def image(self, row: int) -> Image:
        """Return a frame, (H, W) or RGB (H, W, 3) uint8.

        Raises:
            UserError: The file was changed since the recording was opened, or the frames are
                channels.
        """
        if self.dataset is not None:
            return self.dataset.image(self.dataset.samples[self.rows[row]])
        return self._decode(self.paths[row])

    def rest_image(self) -> Image | None:
        """Return the undeformed frame, see ``rest_signal``; None where there is no image."""
        rest = None if isinstance(self.kind, ChannelKind) else self.rest_signal()
        return cast("Image | None", rest)

    def complete_labels(self) -> dict[str, FloatArray]:
        """Return the labels that every frame has."""
        return {name: values for name, values in self.labels.items() if not np.isnan(values).any()}

    def _decode(self, path: Path) -> Image:
        if not isinstance(self.stored, ImageKind):
            raise UserError(f"the frames of {self.folder} are {self.stored} and no images.")
        image = decode_png(path, read_file(path), self.stored)
        return image if self.view is None else self.view.of(image)


def read_dataset(folder: Path) -> Recording:
    """Read the good samples of a data set as a recording.

    Raises:
        UserError: The data set has no good sample, or is damaged.
    """
    dataset = open_dataset(folder)
    header = dataset.header
    samples = [sample for sample in dataset.samples if sample.status == "ok"]
    rows = [int(row) for row in np.flatnonzero(dataset.index.good)]
    if not samples:
        raise UserError(f"{folder} holds no sample that is not bad; record or import some.")
    bad = len(dataset.samples) - len(samples)
    notes = [*dataset.repaired]
    if bad:
        notes.append(f"{bad:,} bad sample{'s' if bad > 1 else ''} left out.")
    if dataset.rest is None:
        notes.append("no frame of the undeformed sensor.")
    return Recording(
        format="v1",
        generation=f"schema {header.schema_version}, {header.status}",
        folder=folder,
        table=folder / JOURNAL,
        names=_frame_names(samples),
        paths=tuple(folder / sample.file_name for sample in samples),
        frames=folder / IMAGES,
        stored=header.kind,
        signal_names=header.signal_names,
        rest=None,
        labels={
            name: np.array([sample.labels.get(name, np.nan) for sample in samples], np.float64)
            for name in dict.fromkeys(name for sample in samples for name in sample.labels)
        },
        scenes=tuple(sample.scene for sample in samples),
        presses=tuple(sample.press for sample in samples),
        sha256=dataset.sha256,
        about=dict(header.source),
        dome_radius_mm=header.dome_radius_mm,
        notes=tuple(notes),
        dataset=dataset,
        rows=tuple(rows),
    )


def _frame_names(samples: Sequence[Sample]) -> tuple[str, ...]:
    """Return the names that frames had before an import, or their files where names repeat."""
    names = [str(sample.extra.get(SOURCE_NAME, sample.file_name)) for sample in samples]
    if max(Counter(names).values()) > 1:
        names = [sample.file_name for sample in samples]
    return tuple(names)
