"""Answers of a faster way to compute against those in float32: what it costs in accuracy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, PlatePose
from tactibench.errors import UserError
from tactibench.plugins import Model, Stage, describe_method

ALLOWED = 0.02
"""Relative change of the mean error up to which a way is allowed, and share of frames in which the
number of contacts may change."""


@dataclass(frozen=True)
class Difference:
    """Answers of one configuration against those in float32, frame by frame.

    Attributes:
        median_mm: Median distance between the two answers, mm; None when no frame can be compared.
        frames: Number of frames that were compared.
        other_count: Number of frames in which the number of contacts differs.
        error_change: Change of the mean distance to the truth, relative to float32; None where it
            is not known.
        largest_mm: Largest distance between the two answers, mm; it is not part of a record.
    """

    median_mm: float | None
    frames: int
    other_count: int
    error_change: float | None = None
    largest_mm: float | None = None

    @property
    def allowed(self) -> bool:
        """Return whether this may stand for float32. Without truth only the counts decide."""
        changed = 0.0 if self.error_change is None else abs(self.error_change)
        return changed < ALLOWED and self.other_count <= ALLOWED * self.frames

    def as_row(self) -> dict[str, Any]:
        """Return JSON values, as a record holds them."""
        return {
            "difference_mm": self.median_mm,
            "frames": self.frames,
            "frames_with_another_count": self.other_count,
            "error_change": self.error_change,
        }


def declared_stages(model: Model) -> list[Stage]:
    """Return the stages that a model declares.

    Raises:
        UserError: They are no pairs of a name and a function, or two have the same name.
    """
    stages: object = model.stages()
    pairs = list(stages) if isinstance(stages, (list, tuple)) else []
    fit = all(
        isinstance(pair, tuple)
        and len(pair) == 2
        and isinstance(pair[0], str)
        and callable(pair[1])
        for pair in pairs
    )
    names = [pair[0] for pair in pairs] if fit else []
    if not names or len(set(names)) < len(names) or "total" in names:
        raise UserError(
            "the stages of the model are no list of (name, function) with different names, none "
            f"of them 'total'; fix {describe_method(model, 'stages')}."
        )
    return pairs


def answers_of(stages: Sequence[Stage], frames: Sequence[Frame]) -> list[Answer | None]:
    """Return the answers of stages at batch 1, frame by frame.

    Raises:
        UserError: The last stage gives something else than a list with one answer.
    """
    answers: list[Answer | None] = []
    for frame in frames:
        value: Any = [frame]
        for _, stage in stages:
            value = stage(value)
        if not isinstance(value, Sequence) or len(value) != 1:
            last = stages[-1][0]
            raise UserError(
                f"the model's stage {last!r} gave {type(value).__name__} where a list with one "
                "answer is asked; the stages of a model must end in what predict answers."
            )
        answers.append(value[0])
    return answers


def compare(
    answers: Sequence[Answer | None],
    scored: Sequence[Answer | None],
    truth: Sequence[Answer] | None = None,
) -> Difference:
    """Compare answers with the float32 answers to the same frames, and both with the truth.

    Args:
        answers: Answers of a way to compute.
        scored: Answers in float32.
        truth: True answers; None where they are not known.
    """
    gaps: list[float] = []
    other_count = 0
    for answer, reference in zip(answers, scored, strict=True):
        distances = _distances(answer, reference)
        if distances is None:
            other_count += 1
        else:
            gaps += distances
    median = float(np.median(gaps)) if gaps else None
    change = _error_change(answers, scored, truth)
    return Difference(median, len(scored), other_count, change, max(gaps, default=None))


def mean_error_mm(answers: Sequence[Answer | None], truth: Sequence[Answer]) -> float | None:
    """Return the mean distance (x, y, depth) from each true contact to the nearest answer, mm.

    For a plate it is the mean error of its depth. Frames without an answer are left out; it is None
    when no frame is left.
    """
    errors = [
        error
        for answer, true in zip(answers, truth, strict=True)
        for error in _errors(answer, true)
    ]
    return float(np.mean(errors)) if errors else None


def _error_change(
    answers: Sequence[Answer | None],
    scored: Sequence[Answer | None],
    truth: Sequence[Answer] | None,
) -> float | None:
    if truth is None:
        return None
    now, before = mean_error_mm(answers, truth), mean_error_mm(scored, truth)
    if now is None or not before:
        return None
    return now / before - 1


def _errors(answer: Answer | None, true: Answer) -> list[float]:
    if isinstance(answer, PlatePose) and isinstance(true, PlatePose):
        return [abs(answer.depth - true.depth)]
    if isinstance(answer, Contacts) and isinstance(true, Contacts) and len(answer) and len(true):
        return _nearest(_points(true), _points(answer))
    return []


def _distances(answer: Answer | None, scored: Answer | None) -> list[float] | None:
    """Return the distances (x, y, depth) between two answers, mm, contact by contact.

    They are None where the numbers of contacts or the kinds of answers differ.
    """
    if answer is None and scored is None:
        return []
    if isinstance(answer, PlatePose) and isinstance(scored, PlatePose):
        return [abs(answer.depth - scored.depth)]
    if not (isinstance(answer, Contacts) and isinstance(scored, Contacts)):
        return None
    if len(answer) != len(scored):
        return None
    # Scores of equal contacts may change order: compare each with the nearest.
    return _nearest(_points(answer), _points(scored)) if len(answer) else []


def _points(contacts: Contacts) -> npt.NDArray[np.float64]:
    return np.column_stack([contacts.xy, contacts.depth])


def _nearest(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> list[float]:
    """Return the distance from each row of a to the nearest row of b."""
    gaps = np.linalg.norm(a[:, None] - b[None], axis=2)
    return [float(gap) for gap in gaps.min(axis=1)]
