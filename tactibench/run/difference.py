"""What a faster way to compute costs in accuracy: its answers beside the float32 ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, PlatePose

ALLOWED = 0.02
"""Relative change of the mean error, and share of frames with another count, still allowed."""


@dataclass(frozen=True)
class Difference:
    """Answers of one configuration against those in float32, frame by frame.

    median_mm: median distance between the two, None when no frame can be compared. frames: how
    many were compared. other_count: in how many of them the number of contacts differs.
    error_change: of the mean distance to the truth, relative to float32; None without truth.
    largest_mm: largest distance between the two; not part of a record.
    """

    median_mm: float | None
    frames: int
    other_count: int
    error_change: float | None = None
    largest_mm: float | None = None

    @property
    def allowed(self) -> bool:
        """Whether this may stand for the float32 answers. Without truth only counts are known."""
        changed = 0.0 if self.error_change is None else abs(self.error_change)
        return changed < ALLOWED and self.other_count <= ALLOWED * self.frames

    def as_row(self) -> dict[str, Any]:
        """JSON values, as a record holds them."""
        return {
            "difference_mm": self.median_mm,
            "frames": self.frames,
            "frames_with_another_count": self.other_count,
            "error_change": self.error_change,
        }


def compare(
    found: Sequence[Answer | None],
    scored: Sequence[Answer | None],
    truth: Sequence[Answer] | None = None,
) -> Difference:
    """Compare answers with the float32 ones of the same frames, and both with the truth."""
    apart: list[float] = []
    changed = 0
    for one, other in zip(found, scored, strict=True):
        distances = _apart(one, other)
        if distances is None:
            changed += 1
        else:
            apart += distances
    median = float(np.median(apart)) if apart else None
    largest = max(apart, default=None)
    return Difference(median, len(scored), changed, _change(found, scored, truth), largest)


def mean_error_mm(answers: Sequence[Answer | None], truth: Sequence[Answer]) -> float | None:
    """Mean distance (x, y, depth) from each true contact to the nearest one answered, mm.

    Of a plate: the mean error of its depth. Frames without an answer are left out; None when that
    is all of them.
    """
    errors = [
        error
        for answer, true in zip(answers, truth, strict=True)
        for error in _errors(answer, true)
    ]
    return float(np.mean(errors)) if errors else None


def _change(
    found: Sequence[Answer | None],
    scored: Sequence[Answer | None],
    truth: Sequence[Answer] | None,
) -> float | None:
    if truth is None:
        return None
    now, before = mean_error_mm(found, truth), mean_error_mm(scored, truth)
    if now is None or not before:
        return None
    return now / before - 1


def _errors(answer: Answer | None, true: Answer) -> list[float]:
    if isinstance(answer, PlatePose) and isinstance(true, PlatePose):
        return [abs(answer.depth - true.depth)]
    if isinstance(answer, Contacts) and isinstance(true, Contacts) and len(answer) and len(true):
        return _nearest(_points(true), _points(answer))
    return []


def _apart(found: Answer | None, scored: Answer | None) -> list[float] | None:
    """Distances (x, y, depth) between answers in mm, contact by contact; None: other counts."""
    if found is None and scored is None:
        return []
    if isinstance(found, PlatePose) and isinstance(scored, PlatePose):
        return [abs(found.depth - scored.depth)]
    if not (isinstance(found, Contacts) and isinstance(scored, Contacts)):
        return None
    if len(found) != len(scored):
        return None
    # Scores of equal contacts may change order: compare each with the nearest.
    return _nearest(_points(found), _points(scored)) if len(found) else []


def _points(contacts: Contacts) -> npt.NDArray[np.float64]:
    return np.column_stack([contacts.xy, contacts.depth])


def _nearest(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> list[float]:
    """From each row of a the distance to the nearest row of b."""
    gaps = np.linalg.norm(a[:, None] - b[None], axis=2)
    return [float(gap) for gap in gaps.min(axis=1)]
