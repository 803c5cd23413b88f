"""Regression of one contact or plate pose per frame: answers as vectors, and their scales."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, PlatePose
from tactibench.errors import UserError

Array = npt.NDArray[np.float64]
ANSWER_WIDTH = {"contacts": 3, "plate": 2}
"""Number of values of an answer: x, y, depth mm of a contact; depth mm, tilt deg of a plate."""


def answer_vectors(truth: Sequence[Answer], answer: str, model: str) -> Array:
    """Return (N, 3) x, y, depth mm of single contacts, or (N, 2) depth mm, tilt deg of plates.

    A frame without contact becomes a row of NaN.

    Args:
        truth: True answers to N frames.
        answer: Kind of the answers, "contacts" or "plate".
        model: Name of the model, for the error.

    Raises:
        UserError: A frame has several contacts.
    """
    rows = np.full((len(truth), ANSWER_WIDTH[answer]), np.nan)
    for row, true in zip(rows, truth, strict=True):
        if isinstance(true, PlatePose):
            row[:] = true.depth, true.tilt
        elif len(true) > 1:
            raise UserError(
                f"model {model!r} answers one contact, but a training frame holds {len(true)}; "
                "train it with --regime single or choose a heatmap model such as unet."
            )
        elif len(true):
            row[:] = *true.xy[0], true.depth[0]
    return rows


def answers_from_vectors(values: npt.NDArray[np.floating], answer: str) -> list[Answer | None]:
    """Return one contact with score 1, or one plate pose, for every row of values.

    Args:
        values: (N, 3) x, y, depth mm, or (N, 2) depth mm, tilt deg.
        answer: Kind of the answers, "contacts" or "plate".
    """
    if answer == "plate":
        return [PlatePose(float(depth), float(tilt)) for depth, tilt in values]
    return [Contacts(row[np.newaxis, :2], row[2:], np.ones(1)) for row in values]


def regression_rows(truth: Sequence[Answer], answer: str, model: str) -> npt.NDArray[np.int64]:
    """Return the rows that hold a contact or a plate pose.

    Args:
        truth: True answers to the frames.
        answer: Kind of the answers, "contacts" or "plate".
        model: Name of the model, for the error.

    Raises:
        UserError: A frame has several contacts.
    """
    return np.flatnonzero(np.isfinite(answer_vectors(truth, answer, model)).all(axis=1))


@dataclass(frozen=True, eq=False)
class Normalisation:
    """Mean and standard deviation of targets or features over the training frames.

    Attributes:
        mean: (T,).
        deviation: (T,) standard deviations.
    """

    mean: Array
    deviation: Array

    @classmethod
    def of(cls, values: Array) -> Self:
        """Return the normalisation of (N, T) values; a column that never varies keeps its unit."""
        deviation = values.std(axis=0)
        return cls(values.mean(axis=0), np.where(deviation > 1e-6, deviation, 1.0))

    def apply(self, values: Array) -> Array:
        """Return values as multiples of the standard deviation from the mean."""
        return np.asarray((values - self.mean) / self.deviation, dtype=np.float64)

    def invert(self, normal: npt.NDArray[np.floating]) -> Array:
        """Return normalised values in their original unit."""
        return np.asarray(normal * self.deviation + self.mean, dtype=np.float64)

    def to_json(self) -> dict[str, list[float]]:
        """Return JSON values from which ``from_json`` makes the same normalisation."""
        return {"mean": self.mean.tolist(), "deviation": self.deviation.tolist()}

    @classmethod
    def from_json(cls, values: dict[str, list[float]]) -> Self:
        """Return the normalisation of ``to_json``."""
        return cls(np.array(values["mean"]), np.array(values["deviation"]))
