"""Tests on hard cases: a frame on which a model fails is counted, and the run continues.

With every other protocol the run stops at such a frame with an error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench.contacts import Contacts, Frame
from tactibench.errors import NotFiniteError
from tactibench.plugins import Model
from tactibench.records import Arrays, pack
from tactibench.run.evaluation import Evaluation
from tactibench.run.examples import example_arrays
from tactibench.run.predict import (
    AnswerRules,
    Answers,
    BadAnswerError,
    Predictions,
    predict_frames,
)
from tactibench.run.timing import Speed

FAILURE_COLUMNS = {"failed": ("i", ()), "raised": ("b", ()), "cause": ("U", ())}
"""Arrays of ``failure_arrays``: kind of type, and shape of a row."""
LONGEST_CAUSE = 200
"""Characters of a cause that are stored: a message may hold a whole array."""
MOST_CAUSES = 20
"""Causes that a record names; it counts the frames of all causes."""


@dataclass(frozen=True)
class Failure:
    """A frame without an answer.

    Attributes:
        row: Row of the frame.
        raised: Whether an exception was raised; otherwise a number was not finite.
        cause: Type and message of the exception, on one line.
    """

    row: int
    raised: bool
    cause: str


class HardCaseEvaluation(Evaluation):
    """The test of a model on frames on which it may fail.

    It is not timed: the weights are those of other protocols, which time them.
    """

    def predict(self) -> Predictions:
        """Return the answers, with no contacts where the model failed, and the failures."""
        frames = self.test.frames
        with self.reporter.task("predict", len(frames)) as advance:
            answers, failures = predict_or_fail(self.model, frames, self.rules, advance)
        return Predictions({**pack(answers, self.kind), **failure_arrays(failures)})

    def time(self) -> Speed:
        """Return no times."""
        return Speed()

    def examples(self) -> Arrays:
        """Return the first frame of every case."""
        first = {group: row for row, group in reversed(list(enumerate(self.test.groups)))}
        return example_arrays(self.test.frames, self.test.truth, None, sorted(first.values()))

    def record(self, predictions: Predictions) -> dict[str, Any]:
        """Return the number of frames on which the model failed, and the causes."""
        return {"failures": failures_record(predictions.arrays, self.test.groups)}


def predict_or_fail(
    model: Model, frames: Sequence[Frame], rules: AnswerRules, advance: Any
) -> tuple[Answers, list[Failure]]:
    """Return the answers of ``predict_frames``, and the frames on which the model failed.

    The answer to such a frame has no contacts. An exception that does not come from the model, such
    as an interruption, is not caught.

    Args:
        model: The trained model.
        frames: Test frames.
        rules: Limits of the answers.
        advance: Function that is called after every frame.
    """
    answers: Answers = []
    failures: list[Failure] = []
    for row, frame in enumerate(frames):
        try:
            predicted, _ = predict_frames(model, [frame], rules, lambda _: None)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin's
            raised = not isinstance(error, NotFiniteError)
            failures.append(Failure(row, raised, _cause(error)))
            predicted = [Contacts.none()]
        answers += predicted
        advance(1)
    return answers, failures


def failure_arrays(failures: Sequence[Failure]) -> Arrays:
    """Return the arrays that are stored with the answers, for F frames without an answer.

    These are failed (F,) rows of the frames, raised (F,) and cause (F,).
    """
    return {
        "failed": np.array([failure.row for failure in failures], dtype=np.int64),
        "raised": np.array([failure.raised for failure in failures], dtype=bool),
        "cause": np.array([failure.cause for failure in failures], dtype=np.str_),
    }


def failures_record(arrays: Mapping[str, Any], groups: Sequence[str]) -> dict[str, Any]:
    """Return the number of failed frames, and causes with their first case and number of frames.

    Args:
        arrays: Arrays of ``failure_arrays``.
        groups: Group of every test frame.
    """
    causes: dict[str, dict[str, Any]] = {}
    for row, cause in zip(arrays["failed"].tolist(), arrays["cause"].tolist(), strict=True):
        entry = causes.setdefault(cause, {"cause": cause, "first": groups[row], "frames": 0})
        entry["frames"] += 1
    return {"frames": len(arrays["failed"]), "causes": list(causes.values())[:MOST_CAUSES]}


def _cause(error: BaseException) -> str:
    """Return type and message of an exception on one line: "ValueError: shapes do not fit"."""
    message = error.found if isinstance(error, BadAnswerError) else str(error)
    text = " ".join(f"{type(error).__name__}: {message}".split())
    return "".join(sign for sign in text if sign.isprintable())[:LONGEST_CAUSE]
