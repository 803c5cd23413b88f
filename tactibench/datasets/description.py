"""Description of a recording: ranges and histograms of labels, pins, frames spread over labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.datasets.readers.recording import Recording
from tactibench.errors import UserError
from tactibench.images import gray

FloatArray = npt.NDArray[np.float64]

BINS = 16
"""Bins of a histogram: as many as fit beside the numbers on a terminal."""
PIN_FRAMES = 64
"""Frames in which pins are counted: enough for a median, few enough for a second of work."""

_BARS = " ▁▂▃▄▅▆▇█"
_POSE = ("x", "y", "yaw", "tilt", "depth")
_SHOWN_LABELS = 3
_FIRST_LABELS = (
    "pose.depth",
    "pose.tilt",
    "pose.x",
    "pose.y",
    "pose_2",
    "pose_6",
    "pose_y",
    "pose_Rz",
)
"""Labels that say most; they come first."""
_CANDIDATES = 2000
"""Most frames from which ``spread_rows`` chooses."""


@dataclass(frozen=True)
class LabelSummary:
    """Range and histogram of a label.

    Attributes:
        name: The label.
        unit: "mm", "deg", or "" where the name does not say.
        low: Smallest value.
        high: Largest value.
        mean: Mean value.
        counts: (BINS,) numbers of frames between low and high.
    """

    name: str
    unit: str
    low: float
    high: float
    mean: float
    counts: tuple[int, ...]

    @property
    def constant(self) -> bool:
        """True where all frames have the same value."""
        return self.low == self.high

    @property
    def bars(self) -> str:
        """One character per bin; the fullest is full, and a bin with any frame shows something."""
        most = max(self.counts)
        levels = (-(-count * (len(_BARS) - 1) // most) for count in self.counts)
        return "".join(_BARS[level] for level in levels)


@dataclass(frozen=True)
class PinSummary:
    """Pins in the frames of a recording.

    Attributes:
        frames: Number of frames in which pins were counted.
        counts: Number of pins in each frame, 0 where there are none.
        rest: Number of pins in the rest frame, None without a rest frame.
        visible_share: Share of the frames in which every pin of the rest frame was seen.
        moved_px: Largest displacement of a pin from rest, median over the frames.
    """

    frames: int
    counts: tuple[int, ...]
    rest: int | None
    visible_share: float | None
    moved_px: float | None


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


def summarize_labels(values: Mapping[str, FloatArray]) -> list[LabelSummary]:
    """Return range and histogram of every label that any frame has."""
    summaries = []
    for name, column in values.items():
        finite = column[np.isfinite(column)]
        if len(finite):
            low, high = float(finite.min()), float(finite.max())
            counts, _ = np.histogram(finite, BINS, range=(low, high if high > low else low + 1))
            bins = tuple(counts.tolist())
            summaries.append(
                LabelSummary(name, unit_of(name), low, high, float(finite.mean()), bins)
            )
    return summaries


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


def describe_poses(labels: Mapping[str, FloatArray]) -> str:
    """Return in words which object a robot's pose labels suggest; "" where no label changes.

    The labels that change decide. Lengths are pose_1 to 3 or pose_x to z, angles pose_4 to 6 or
    pose_Rx to Rz; moves or shears say how the skin was dragged.
    """
    changing = [name for name, column in labels.items() if np.ptp(column) > 0]
    poses = [name for name in changing if name.startswith("pose_")]
    lengths = [name for name in poses if unit_of(name) == "mm"]
    angles = [name for name in poses if unit_of(name) == "deg"]
    drags = [name for name in changing if name.startswith(("move_", "shear_"))]
    if not poses and not drags:
        return ""
    names = ", ".join(lengths + angles) or "no pose"
    if len(lengths) == 1 and angles:
        kind = "a plate that is tilted, or an edge that is turned; the frames tell which"
    elif angles:
        kind = "an edge or another object at several places and angles, no plate"
    elif len(lengths) > 1:
        kind = "a tip or an object at several places, no tilted plate"
    else:
        kind = "presses at one place, no tilted plate"
    text = f"poses ({names} change) look like {kind}"
    return text + (f"; the skin is dragged ({', '.join(drags)})" if drags else "")


def changing_labels(values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return at most three labels that every frame has and that change, in order of importance."""
    changing = [
        name for name, column in values.items() if np.isfinite(column).all() and np.ptp(column) > 0
    ]
    rank = {name: number for number, name in enumerate(_FIRST_LABELS)}
    changing.sort(key=lambda name: rank.get(name, len(rank)))
    return {name: values[name] for name in changing[:_SHOWN_LABELS]}


def summarize_pins(recording: Recording, most: int = PIN_FRAMES) -> PinSummary:
    """Count the pins in frames evenly spread over the table, and follow them from rest.

    Args:
        recording: The recording.
        most: Largest number of frames to look at.
    """
    from tactibench.markers import Tracker, count_pins

    count = min(most, len(recording))
    rows = np.linspace(0, len(recording) - 1, count).round().astype(int).tolist()
    images = [gray(recording.image(row)) for row in rows]
    counts = []
    for image in images:
        try:
            counts.append(count_pins(image))
        except UserError:  # fewer than three pins
            counts.append(0)
    rest = recording.rest_image()
    try:
        tracker = None if rest is None else Tracker(gray(rest))
    except UserError:
        tracker = None
    if tracker is None:
        return PinSummary(len(rows), tuple(counts), None if rest is None else 0, None, None)
    tracks = tracker.track(np.stack(images))
    moved = np.linalg.norm(tracks.xy - tracker.rest, axis=2).max(axis=1)
    return PinSummary(
        len(rows),
        tuple(counts),
        len(tracker.rest),
        float(tracks.seen.all(axis=1).mean()),
        float(np.median(moved)),
    )


def channel_ranges(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest value of every channel, (C,) each."""
    rows = np.stack([recording.signal(row) for row in range(len(recording))])
    flat = rows.reshape(len(recording), -1).astype(np.float64)
    return flat.min(axis=0), flat.max(axis=0)


def spread_rows(labels: Sequence[FloatArray], frames: int, count: int, columns: int) -> list[int]:
    """Return rows of frames that are far from each other in the labels.

    Each next frame is the farthest from those that were chosen before.

    Args:
        labels: (N,) values of each label; the first label orders the lines of a sheet, the second
            the frames along a line.
        frames: Number N of frames.
        count: Number of rows to return, or N where there are fewer.
        columns: Number of frames in a line of the sheet.
    """
    rows = np.linspace(0, frames - 1, min(frames, _CANDIDATES)).round().astype(int)
    count = min(count, len(rows))
    if not labels:
        return [int(row) for row in rows[np.linspace(0, len(rows) - 1, count).round().astype(int)]]
    points = np.column_stack([column[rows] for column in labels])
    points = (points - points.min(axis=0)) / np.maximum(np.ptp(points, axis=0), 1e-12)
    chosen = [int(np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        farthest = int(np.argmax(distance))
        if farthest in chosen:  # the others have the labels of frames that were chosen
            farthest = next(row for row in range(len(rows)) if row not in chosen)
        chosen.append(farthest)
        distance = np.minimum(distance, np.linalg.norm(points - points[farthest], axis=1))
    chosen.sort(key=lambda row: float(points[row, 0]))
    second = min(1, len(labels) - 1)
    ordered: list[int] = []
    for start in range(0, len(chosen), columns):
        line = chosen[start : start + columns]
        ordered += sorted(line, key=lambda row: float(points[row, second]))
    return [int(rows[row]) for row in ordered]
