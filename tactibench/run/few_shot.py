"""Tests after a few labelled frames of the tested sensor.

A protocol that changes the sensor names several numbers of labelled frames. Every test frame is
answered once for each number, and these answers are a group that is named by the number. A model
that cannot adapt is shown no labelled frame and has the group "0".

With other protocols ``--test shots=N`` requests one number. Their groups stay the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from tactibench.contacts import Answer, Frame
from tactibench.frames import check_labelled, true_answers
from tactibench.plugins import Model
from tactibench.records import Arrays, pack
from tactibench.run.components import cannot_adapt
from tactibench.run.evaluation import Evaluation, TestFrames, truth_arrays
from tactibench.run.plan import RunPlan
from tactibench.run.predict import Answers, HeatMaps, Predictions, predict_frames
from tactibench.run.reporter import Reporter, open_frames

Row = TypeVar("Row")


class AdaptedEvaluation(Evaluation):
    """The test of a model that has adapted to labelled presses of the tested sensor.

    Attributes:
        count: Number of labelled presses.
        chosen: What the model chose when it adapted.

    Raises:
        UserError: The labels do not fit the frames, or the model cannot adapt.
    """

    def __init__(self, plan: RunPlan, model: Model, test: TestFrames, reporter: Reporter) -> None:
        super().__init__(plan, model, test, reporter)
        few_shot = plan.frames.few_shot
        assert few_shot is not None  # noqa: S101 - a plan with shots has them
        presses = open_frames(few_shot, reporter)
        labels = true_answers(plan.spec, [presses])
        check_labelled(presses.frames, labels, test.frames[0], plan.context())
        self.count = len(presses)
        with reporter.task("adapt", self.count) as advance:
            chosen = model.adapt(list(presses.frames), labels)
            advance(self.count)
        # Whether a model adapts may depend on its parameters or its training.
        if chosen is None:
            raise cannot_adapt(plan.components.model.label)
        self.chosen = chosen

    def record(self, predictions: Predictions) -> dict[str, Any]:  # noqa: ARG002
        """Return the frames of the tested sensor that the model was shown, and its choices."""
        return {
            "of_tested_sensor": {
                "rest_image": True,
                "unlabelled_frames": 0,
                "labelled_frames": [self.count],
                "adapted": [{"shots": self.count, **self.chosen}],
            }
        }


class FewShotEvaluation(Evaluation):
    """The test of a model on another sensor, once for each number of its labelled frames.

    Attributes:
        counts: Numbers of labelled frames; (0,) for a model that cannot adapt.
        frames: Labelled frames of the tested sensor.
        labels: True answers to these frames.
        adapts: Whether the model can adapt.

    Raises:
        UserError: The labels do not fit the frames.
    """

    def __init__(self, plan: RunPlan, model: Model, test: TestFrames, reporter: Reporter) -> None:
        super().__init__(plan, model, test, reporter)
        self.counts: tuple[int, ...] = (0,)
        self.frames: Sequence[Frame] = ()
        self.labels: Sequence[Answer] = ()
        transfer, few_shot = plan.spec.transfer, plan.frames.few_shot
        self.adapts = model.adapt([], []) is not None
        if self.adapts and transfer is not None and few_shot is not None:
            presses = open_frames(few_shot, reporter)
            self.counts = transfer.shots
            self.frames, self.labels = presses.frames, true_answers(plan.spec, [presses])
            check_labelled(self.frames, self.labels, test.frames[0], plan.context())

    def predict(self) -> Predictions:
        """Return the answers after each number of labelled frames, one number after the other.

        The heatmaps are those without labelled frames. The model is left as it was trained.
        """
        frames = self.test.frames
        answers: Answers = []
        heat: HeatMaps | None = None
        with self.reporter.task("predict", len(frames) * len(self.counts)) as advance:
            for count in self.counts:
                self._adapt(count)
                predicted, maps = predict_frames(self.model, frames, self.rules, advance)
                answers += predicted
                heat = maps if count == 0 else heat
        self._adapt(0)
        return Predictions(pack(answers, self.kind), heat)

    def truth(self) -> Arrays:
        """Return the true answers once for each number of labelled frames."""
        test, counts = self.test, self.counts
        return truth_arrays(
            self.kind,
            repeat(test.truth, counts),
            repeat(test.clusters, counts),
            count_groups(len(test.frames), counts),
        )

    def record(self, predictions: Predictions) -> dict[str, Any]:  # noqa: ARG002
        """Return the frames of the tested sensor that the model was shown, and its choices."""
        frames = self.plan.frames
        adapted = []
        if self.adapts:
            adapted = [{"shots": count, **self._adapt(count)} for count in self.counts]
            self._adapt(0)
        return {
            "of_tested_sensor": {
                "rest_image": True,
                "unlabelled_frames": 0,
                "labelled_frames": list(self.counts),
                "left_out_calibrated": frames.calibrated,
                "described": (frames.test_identity or {}).get("describe", {}),
                "adapted": adapted,
            }
        }

    def _adapt(self, count: int) -> Mapping[str, Any]:
        return self.model.adapt(list(self.frames[:count]), list(self.labels[:count])) or {}


def repeat(rows: Sequence[Row], counts: Sequence[int]) -> list[Row]:
    """Return the rows of all test frames, once for each number of labelled frames."""
    return list(rows) * len(counts)


def count_groups(frames: int, counts: Sequence[int]) -> list[str]:
    """Return the group of every answer: the number of labelled frames before it."""
    return [str(count) for count in counts for _ in range(frames)]
