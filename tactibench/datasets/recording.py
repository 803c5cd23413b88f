"""A recording of any format: frames on the disk with their labels.

Pins are cut out of raw pictures, and a rest frame that is missing is estimated.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Scene, Signal, Sites
from tactibench.datasets.labels import (
    AUTO,
    EVEN,
    PLATE,
    ImportOptions,
    Labels,
    role_columns,
    scenes_of,
)
from tactibench.datasets.pictures import read_picture
from tactibench.datasets.schema import (
    IMAGES,
    JOURNAL,
    ChannelKind,
    Dataset,
    Forces,
    Image,
    Sample,
    open_dataset,
)
from tactibench.datasets.tables import spread_evenly
from tactibench.errors import UserError
from tactibench.images import gray
from tactibench.markers import PinView, choose_light, find_pin_view
from tactibench.png import ImageKind

FloatArray = npt.NDArray[np.float64]

SOURCE_NAME = "source_name"
"""Key of a sample's ``extra``: the name of its frame in the folder that was imported."""
PIN_FRAMES = 64
"""Frames in which pins are counted: enough for a median, few enough for a second of work."""

_POSE = ("x", "y", "yaw", "tilt", "depth")
_SHOWN_LABELS = 3
_FIRST_LABELS = ["pose.depth", "pose.tilt", "pose.x", "pose.y"]
_FIRST_LABELS += ["pose_2", "pose_6", "pose_y", "pose_Rz"]
"""Labels that say most; they come first."""
_PROBES = 5
"""Frames in which pins are looked for both ways, beside the rest frame."""
_LIGHT_MM = 0.3
"""Depth to which a tip counts as hardly pressed: pins move by less than a tenth of it."""
_FEWEST, _MOST = 9, 25
"""Numbers of hardly pressed frames from which the rest frame is estimated: in the median of nine at
different places, the two or three in which a pin was moved do not count."""


@dataclass(frozen=True, eq=False)
class Recording:
    """N frames with their labels; every file was read once and is sound.

    Attributes:
        format: "bristol", "csv", "channels" or "v1".
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
        sites: Labels that say which named places are touched.
        sessions: Session in which every frame was recorded; () where no session is known.
        sha256: Hash over the table and the frames.
        forces: Forces of the contacts of every frame, N; None where they are not known.
        columns: Role, such as "depth" -> column.
        extra: Other columns -> (N,) texts.
        about: Name of a file beside the table -> its content; of a data set, its source.
        dome_radius_mm: Radius of the pressed surface, inf where it is flat, None if unknown.
        notes: Sentences about facts that were left out or are missing.
        values: (N, ...) float32 channels, of a sensor without a camera.
        signal_names: Names of the channels.
        bits: Bits of the brightest pixel of a recording of pictures.
        view: Part of raw pictures that shows the pins; frames are this part of them.
        light: "as_is" or "even", with the numbers of pins by which it was chosen.
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
    labels: Labels
    scenes: tuple[Scene | None, ...]
    presses: tuple[str, ...]
    sha256: str
    forces: tuple[Forces | None, ...] = field(repr=False)
    columns: Mapping[str, str] = field(default_factory=dict)
    extra: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)
    dome_radius_mm: float | None = None
    notes: tuple[str, ...] = ()
    values: npt.NDArray[np.float32] | None = field(default=None, repr=False)
    signal_names: tuple[str, ...] = ()
    bits: int = 8
    view: PinView | None = None
    light: str = ""
    estimated_rest: Signal | None = field(default=None, repr=False)
    dataset: Dataset | None = None
    rows: tuple[int, ...] = ()
    sites: tuple[str, ...] = ()
    sessions: tuple[str, ...] = ()

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

    def force(self, row: int) -> FloatArray | None:
        """Return the (K, 3) forces of the contacts of a frame, N; None: not recorded."""
        known = self.forces[row]
        return None if known is None else np.array(known, dtype=np.float64).reshape(-1, 3)

    def signal(self, row: int) -> Signal:
        """Return the signal of a frame: its image, or its channels.

        Raises:
            UserError: The file was changed since the recording was opened.
        """
        if self.dataset is not None:
            return self.dataset.signal(self.dataset.samples[self.rows[row]])
        return self._decode(self.paths[row]) if self.values is None else self.values[row]

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
        if isinstance(self.kind, ChannelKind):
            raise UserError(f"the frames of {self.folder} are {self.kind} and no images.")
        return cast("Image", self.signal(row))

    @property
    def rest_name(self) -> str | None:
        """Name of the frame of the undeformed sensor; None where there is none."""
        if self.estimated_rest is not None:
            return "estimated from the least pressed frames"
        if self.rest is not None:
            return self.rest.name
        return None if self.rest_signal() is None else "rest"

    def rest_image(self) -> Image | None:
        """Return the undeformed frame, see ``rest_signal``; None where there is no image."""
        rest = None if isinstance(self.kind, ChannelKind) else self.rest_signal()
        return cast("Image | None", rest)

    def complete_labels(self) -> dict[str, FloatArray]:
        """Return the labels that every frame has."""
        return {name: values for name, values in self.labels.items() if not np.isnan(values).any()}

    def site_scenes(self) -> tuple[Scene, ...]:
        """Return the scene of every frame by the named places that it touches.

        Raises:
            UserError: A label of a place is neither 0 nor 1.
        """
        touched = np.column_stack([self.labels[name] for name in self.sites])
        bad = np.argwhere(~np.isin(touched, (0, 1)))
        if len(bad):
            row, column = bad[0]
            raise UserError(
                f"{self.table} row {row + 1}: {self.sites[column]} is {touched[row, column]:g}, "
                "but a place is touched (1) or not (0); correct it."
            )
        return tuple(Scene.of_sites(Sites.truth(self.sites, row)) for row in touched)

    def plate_scenes(self, options: ImportOptions) -> tuple[tuple[Scene, ...], dict[str, str]]:
        """Read the labels as those of a plate.

        Returns:
            The scene of every frame, and role -> column.

        Raises:
            UserError: A column is missing, or the depth column never changes.
        """
        labels = self.complete_labels()
        columns = role_columns(options, PLATE, labels, self.table)
        return scenes_of(labels, columns, options, PLATE, self.table) or (), columns

    def _decode(self, path: Path) -> Image:
        image = read_picture(path, cast("ImageKind", self.stored), self.bits)
        return image if self.view is None else self.view.of(image)


def read_dataset(folder: Path) -> Recording:
    """Read the good samples of a data set as a recording.

    Raises:
        UserError: The data set has no good sample, or is damaged.
    """
    dataset = open_dataset(folder)
    header = dataset.header
    good = {row: sample for row, sample in enumerate(dataset.samples) if sample.status == "ok"}
    samples = list(good.values())
    if not samples:
        raise UserError(f"{folder} holds no sample that is not bad; record or import some.")
    bad = len(dataset.samples) - len(samples)
    notes = []
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
        forces=tuple(sample.contacts_force_n for sample in samples),
        sha256=dataset.sha256,
        about=dict(header.source),
        dome_radius_mm=header.dome_radius_mm,
        notes=tuple(notes),
        dataset=dataset,
        rows=tuple(good),
        sites=header.sites,
        sessions=tuple(sample.session for sample in samples),
    )


def _frame_names(samples: Sequence[Sample]) -> tuple[str, ...]:
    """Return the names that frames had before an import, or their files where names repeat."""
    names = [str(sample.extra.get(SOURCE_NAME, sample.file_name)) for sample in samples]
    if max(Counter(names).values()) > 1:
        names = [sample.file_name for sample in samples]
        if max(Counter(names).values()) > 1:  # one file holds the channels of all
            names = [f"sample-{sample.id:06d}" for sample in samples]
    return tuple(names)


def prepare_frames(recording: Recording, light: str) -> Recording:
    """Return the recording with a view of its pins where frames are raw, and a rest frame.

    Args:
        recording: A recording of images.
        light: "even" cuts pins out of pictures, "as_is" does not, "auto" does where that shows
            more pins.

    Raises:
        UserError: Pins are to be cut out, and none are found.
    """
    probes = spread_evenly(len(recording), _PROBES)
    try:
        rest = recording.rest_image()
        images = [] if rest is None else [rest]
        images += [recording.image(row) for row in probes.tolist()]
    except UserError:  # reported where the frame is needed; the labels can be read
        return recording
    notes = list(recording.notes)
    view, chosen = find_pin_view(images[0]) if light == EVEN else None, light
    if light == AUTO:
        view, chosen = choose_light(images)
    recording = replace(recording, view=view, light=chosen)
    if view is not None:
        notes.append(
            f"raw camera frames: pins are cut out ({view}), evenly lit and gray; --param "
            "light=as_is leaves frames as they are."
        )
    rows = _hardly_pressed(recording.scenes) if rest is None else []
    if rows:
        median = np.median([recording.image(row) for row in rows], axis=0)
        recording = replace(recording, estimated_rest=np.rint(median).astype(np.uint8))
        notes.append(
            f"no frame of the undeformed sensor in {recording.frames.name}: it is estimated, the "
            f"median of the {len(rows)} least pressed frames (add one as init_0.png)."
        )
    elif rest is None:
        notes.append(
            f"no frame of the undeformed sensor in {recording.frames.name}: models that follow "
            "pins from the rest layout cannot be run on it (add one as init_0.png)."
        )
    return replace(recording, notes=tuple(notes))


def prepare_channels(recording: Recording) -> Recording:
    """Return a recording of channels with the signal at rest, where rows touch nothing.

    A note says what is not known: the depth, where no column states it.
    """
    notes, scenes = list(recording.notes), [scene for scene in recording.scenes if scene]
    if any(math.isnan(scene.pose.depth) for scene in scenes):
        notes.append("depth is not known: no column was named (--param depth=COLUMN).")
    resting = [row for row, s in enumerate(recording.scenes) if s is not None and s.pose.depth <= 0]
    if resting:
        text = f"{len(resting):,} rows touch nothing"
        if recording.values is not None and len(resting) >= _FEWEST:
            rest = np.median(recording.values[resting], axis=0)
            recording = replace(recording, estimated_rest=rest.astype(np.float32))
            text += "; the sensor at rest is their median"
        notes.append(f"{text}.")
    return replace(recording, notes=tuple(notes))


def _hardly_pressed(scenes: tuple[Scene | None, ...]) -> list[int]:
    """Return the rows of the least pressed frames; [] where too few are hardly pressed.

    A plate moves most pins at once, so that it must not touch.
    """
    depth = np.array([np.inf if s is None else s.pose.depth for s in scenes])
    limit = np.array([0.0 if s is None or s.indenter.is_plate else _LIGHT_MM for s in scenes])
    rows = np.flatnonzero(depth <= limit)
    if len(rows) < _FEWEST:
        return []
    least: list[int] = rows[np.argsort(depth[rows], kind="stable")][:_MOST].tolist()
    return least


def label_values(recording: Recording) -> dict[str, FloatArray]:
    """Return name -> (N,) of every number that is known of the frames, NaN where a frame has none.

    The pose of the indenter comes first, as pose.x ... pose.depth, then the labels.
    """
    values: dict[str, FloatArray] = {}
    if any(recording.scenes):
        for field in _POSE:
            values[f"pose.{field}"] = np.array(
                [np.nan if s is None else getattr(s.pose, field) for s in recording.scenes]
            )
    return values | dict(recording.labels)


def label_ranges(recording: Recording) -> dict[str, tuple[float, float, float]]:
    """Return label -> its least, mean and largest value, of every label that any frame has."""
    values = label_values(recording).items()
    known = {name: kept for name, column in values if len(kept := column[np.isfinite(column)])}
    return {n: (float(v.min()), float(v.mean()), float(v.max())) for n, v in known.items()}


def unit_of(name: str) -> str:
    """Return "deg" for rotations and angles, "mm" for lengths, "" where the name does not say."""
    stem, _, last = name.rpartition("_")
    if last.isdigit() and stem != "pose":  # a column without a name
        return ""
    last = last.rpartition(".")[2]
    if last in {"yaw", "tilt", "deg", "4", "5", "6", "Rx", "Ry", "Rz"}:
        return "deg"
    if last in {"1", "2", "3", "x", "y", "z", "mm", "depth"}:
        return "mm"
    return ""


def pin_counts(recording: Recording, most: int = PIN_FRAMES) -> tuple[list[int], int | None]:
    """Return the numbers of pins in frames spread over the table, and in the rest frame.

    Args:
        recording: The recording.
        most: Largest number of frames to look at.

    Returns:
        The number for every frame, 0 for fewer than three pins, and None without a rest frame.
    """
    from tactibench.markers import count_pins

    def count(image: Image) -> int:
        try:
            return count_pins(gray(image))
        except UserError:  # fewer than three pins
            return 0

    rows = spread_evenly(len(recording), most)
    rest = recording.rest_image()
    counts = [count(recording.image(row)) for row in rows.tolist()]
    return counts, None if rest is None else count(rest)


def spread_rows(values: Labels, frames: int, count: int) -> tuple[list[str], list[int]]:
    """Return the labels that change, and rows of frames evenly spread over the first of them.

    Args:
        values: Label -> (N,) values.
        frames: Number N of frames.
        count: Most rows to return.
    """
    changing = [n for n, v in values.items() if np.isfinite(v).all() and np.ptp(v) > 0]
    changing.sort(key=lambda n: _FIRST_LABELS.index(n) if n in _FIRST_LABELS else 99)
    names = changing[:_SHOWN_LABELS]
    order = np.lexsort([values[name] for name in reversed(names)]) if names else np.arange(frames)
    return names, order[spread_evenly(frames, count)].tolist()
