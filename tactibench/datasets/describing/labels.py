"""Labels in words and small histograms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.datasets.importing import Recording

FloatArray = npt.NDArray[np.float64]

BINS = 16
_BARS = " ▁▂▃▄▅▆▇█"
_POSE = ("x", "y", "yaw", "tilt", "depth")


@dataclass(frozen=True)
class Label:
    """counts: (BINS,) between low and high; known: how many frames have the label."""

    name: str
    unit: str
    low: float
    high: float
    mean: float
    known: int
    counts: tuple[int, ...]

    @property
    def constant(self) -> bool:
        return self.low == self.high

    @property
    def bars(self) -> str:
        """One character a bin, the fullest is full; a bin with any frame shows something."""
        most = max(self.counts)
        levels = (-(-count * (len(_BARS) - 1) // most) for count in self.counts)
        return "".join(_BARS[level] for level in levels)


def known_values(recording: Recording) -> dict[str, FloatArray]:
    """Every number that is known of the frames: what was pressed, then the labels.

    NaN where a frame has none. Parts of the pose are called pose.x ... pose.depth.
    """
    values: dict[str, FloatArray] = {}
    if any(recording.scenes):
        for part in _POSE:
            values[f"pose.{part}"] = np.array(
                [np.nan if s is None else getattr(s.pose, part) for s in recording.scenes]
            )
    return values | dict(recording.labels)


def describe_labels(values: Mapping[str, FloatArray]) -> list[Label]:
    """Range and histogram of every label that any frame has."""
    found = []
    for name, column in values.items():
        known = column[np.isfinite(column)]
        if len(known):
            low, high = float(known.min()), float(known.max())
            counts, _ = np.histogram(known, BINS, range=(low, high if high > low else low + 1))
            found.append(
                Label(
                    name,
                    unit_of(name),
                    low,
                    high,
                    float(known.mean()),
                    len(known),
                    tuple(counts.tolist()),
                )
            )
    return found


def unit_of(name: str) -> str:
    """deg for rotations and angles, mm for lengths, nothing where the name does not say."""
    last = name.rpartition("_")[2].rpartition(".")[2]
    if last in {"yaw", "tilt", "deg", "4", "5", "6", "Rx", "Ry", "Rz"}:
        return "deg"
    if last in {"1", "2", "3", "x", "y", "z", "mm", "depth"}:
        return "mm"
    return ""


def varying(values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Those that every frame has, and that change."""
    return {
        name: column
        for name, column in values.items()
        if np.isfinite(column).all() and np.ptp(column) > 0
    }
