"""The test of a trained model: predictions, times, examples and entries of the record.

Tests of another kind are in ``special_evaluations``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench.channels import holds_channels
from tactibench.contacts import Answer, Contacts, Frame
from tactibench.frames import FrameSource, Presses, spread, true_answers
from tactibench.plugins import Model
from tactibench.records import Arrays, pack
from tactibench.run.plan import RunPlan
from tactibench.run.predict import AnswerRules, Predictions, predict_frames
from tactibench.run.reporter import Reporter, open_frames
from tactibench.run.timing import Speed, time_model

EXAMPLES = 24
"""Test frames that stay with a run: enough for its pictures."""


@dataclass(frozen=True)
class TestFrames:
    """The test frames of a run.

    Attributes:
        sets: Presses with their frames.
        main: Number of sets that are not scored apart; they are the first.
        frames: Frames of all sets in order.
        names: Name of every frame.
        truth: True answer to every frame.
        groups: Group of every frame.
        clusters: Press that every frame belongs to.
    """

    __test__ = False  # not a test case, whatever its name

    sets: tuple[Presses, ...]
    main: int
    frames: Sequence[Frame]
    names: Sequence[str]
    truth: Sequence[Answer]
    groups: Sequence[str]
    clusters: Sequence[str]

    @property
    def main_frames(self) -> int:
        """Return the number of frames that are not scored apart; they are the first."""
        return sum(map(len, self.sets[: self.main]))

    @classmethod
    def open(cls, plan: RunPlan, reporter: Reporter) -> TestFrames:
        """Return the test frames of a plan, made where they are not in the cache."""
        planned = plan.frames.test
        sets = tuple(open_frames(frames, reporter) for frames in planned)
        return cls(
            sets,
            sum(not frames.apart for frames in planned),
            [frame for presses in sets for frame in presses.frames],
            [name for presses in sets for name in presses.names],
            true_answers(plan.spec, sets),
            [group for frames in planned for group in frames.groups],
            [press for frames in planned for press in frames.clusters],
        )


class Evaluation:
    """The test of a trained model on all frames, each answered once.

    Attributes:
        plan: The plan of the run.
        model: The trained model.
        test: The test frames.
        reporter: Shows the work.
        kind: Kind of the answers, "contacts", "plate" or "sites".
        rules: Limits of the answers.
    """

    def __init__(self, plan: RunPlan, model: Model, test: TestFrames, reporter: Reporter) -> None:
        self.plan, self.model, self.test, self.reporter = plan, model, test, reporter
        self.kind = plan.spec.answer
        most = plan.components.model.spec.max_contacts
        knows_depth = all(t.knows_depth for t in test.truth if isinstance(t, Contacts))
        self.rules = AnswerRules(self.kind, most, plan.spec.grid.grid().shape, knows_depth)

    def predict(self) -> Predictions:
        """Return the model's answers to all test frames.

        Raises:
            UserError: The model answers something else than it declared.
        """
        frames = self.test.frames
        with self.reporter.task("predict", len(frames)) as advance:
            answers, maps = predict_frames(self.model, frames, self.rules, advance)
        return Predictions.of(answers, maps, self.kind)

    def truth(self) -> Arrays:
        """Return the true answers, packed, with press and group of every frame."""
        test, source = self.test, self.plan.frames.source
        return truth_arrays(source, test.truth, test.clusters, test.groups)

    def time(self) -> Speed:
        """Return the model's times for the main test frames."""
        frames = self.test.frames[: self.test.main_frames]
        with self.reporter.task("time", 1) as advance:
            speed = time_model(self.model, frames, quick=self.plan.request.quick)
            advance(1)
        return speed

    def examples(self) -> Arrays:
        """Return a few frames that stay with the run, for its pictures."""
        count = self.test.main_frames
        return example_arrays(self.test.frames[:count])

    def record(self, predictions: Predictions) -> dict[str, Any]:  # noqa: ARG002
        """Return the entries that the record has for this test beyond its metrics."""
        return {}


def truth_arrays(
    source: FrameSource, answers: Sequence[Answer], clusters: Sequence[str], groups: Sequence[str]
) -> Arrays:
    """Return packed answers with ``press`` and ``group`` of every frame; a gate that is its own.

    Args:
        source: Source of the frames, whose range the gate grows with.
        answers: True answer to every frame.
        clusters: Press that every frame belongs to.
        groups: Group of every frame.
    """
    truth = pack(answers, source.spec.answer)
    truth |= {"press": np.array(clusters), "group": np.array(groups)}
    if source.tested_workspace is not None:
        truth["gate"] = np.array(source.gate_mm)
    return truth


def example_arrays(frames: Sequence[Frame], rows: Sequence[int] | None = None) -> Arrays:
    """Return frames of a test.

    Args:
        frames: Frames of the whole test.
        rows: Rows of the frames that are stored; None: rows spread over all frames.

    Returns:
        index (E,) and images or channels (E, ...).
    """
    rows = spread(range(len(frames)), EXAMPLES) if rows is None else tuple(rows)
    name = "channels" if holds_channels(frames) else "images"
    signals = np.stack([frames[row].signal for row in rows])
    return {"index": np.array(rows, dtype=np.int64), name: signals}
