"""Truth as vectors that a network can regress, and answers back from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench import Answer, Contacts, PlatePose, UserError

Vector = npt.NDArray[np.float64]
NAMES = {"contacts": ("x", "y", "depth"), "plate": ("depth", "tilt")}


def vectors(truth: Sequence[Answer], answer: str) -> Vector:
    """(N, 3) x, y, depth mm of single contacts, or (N, 2) depth mm, tilt deg of plates.

    A frame without contact becomes a row of NaN. Raises UserError for a frame with several.
    """
    rows = np.full((len(truth), len(NAMES[answer])), np.nan)
    for row, true in zip(rows, truth, strict=True):
        if isinstance(true, PlatePose):
            row[:] = true.depth, true.tilt
        elif len(true) > 1:
            raise UserError(
                f"model 'cnn' answers one contact, but a training frame holds {len(true)}; "
                "train it with --regime single or choose a heatmap model such as unet."
            )
        elif len(true):
            row[:] = *true.xy[0], true.depth[0]
    return rows


@dataclass(frozen=True, eq=False)
class Normalisation:
    """Targets to zero mean and unit deviation over the training frames, and back."""

    mean: Vector
    deviation: Vector

    @classmethod
    def of(cls, values: Vector) -> Normalisation:
        """Fit to (N, T) targets; one that never varies keeps its unit."""
        deviation = values.std(axis=0)
        return cls(values.mean(axis=0), np.where(deviation > 1e-6, deviation, 1.0))

    def apply(self, values: Vector) -> npt.NDArray[np.float32]:
        return ((values - self.mean) / self.deviation).astype(np.float32)

    def invert(self, normal: npt.NDArray[np.float32]) -> Vector:
        return np.asarray(normal * self.deviation + self.mean, dtype=np.float64)


def answers(values: Vector, answer: str) -> list[Answer | None]:
    """One contact with score 1, or one plate pose, per row."""
    if answer == "plate":
        return [PlatePose(float(depth), float(tilt)) for depth, tilt in values]
    return [Contacts(row[np.newaxis, :2], row[2:], np.ones(1)) for row in values]
