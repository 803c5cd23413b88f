"""The tests of models that are shown labelled frames, meet hard cases, or are trained in folds.

Tests after a few labelled frames of the tested sensor: a protocol that changes the sensor names
several numbers of labelled frames. Every test frame is answered once for each number, and these
answers are a group that is named by the number. A model that cannot adapt is shown no labelled
frame and has the group "0". With other protocols ``--test shots=N`` requests one number. Their
groups stay the same.

Tests on hard cases: a frame on which a model fails is counted, and the run continues. With every
other protocol the run stops at such a frame with an error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Contacts, Frame
from tactibench.errors import NotFiniteError
from tactibench.frames import FrameSource, true_answers
from tactibench.plugins import Model
from tactibench.records import Arrays
from tactibench.run.components import cannot_adapt
from tactibench.run.evaluation import Evaluation, TestFrames, example_arrays, truth_arrays
from tactibench.run.plan import RunPlan
from tactibench.run.predict import (
    AnswerRules,
    Answers,
    HeatMaps,
    Predictions,
    failure_cause,
    predict_frames,
)
from tactibench.run.reporter import Reporter, open_frames
from tactibench.run.timing import Speed
from tactibench.run.weights import train_model

FAILURE_COLUMNS = {"failed": ("i", ()), "raised": ("b", ()), "cause": ("U", ())}
"""Arrays of failures, see ``predict_or_fail``: kind of type, and shape of a row."""
MOST_CAUSES = 20
"""Causes that a record names; it counts the frames of all causes."""


class AdaptedEvaluation(Evaluation):
    """The test of a model that has adapted to labelled presses of the tested sensor.

    Attributes:
        count: Number of labelled presses.
        chosen: What the model chose when it adapted.

    Raises:
        UserError: The model cannot adapt.
    """

    def __init__(self, plan: RunPlan, model: Model, test: TestFrames, reporter: Reporter) -> None:
        super().__init__(plan, model, test, reporter)
        few_shot = plan.frames.few_shot
        assert few_shot is not None  # noqa: S101 - a plan with shots has them
        presses = open_frames(few_shot, reporter)
        labels = true_answers(plan.spec, [presses])
        self.count = len(presses)
        with reporter.task("adapt", self.count) as advance:
            chosen = model.adapt(presses.frames, labels)
            advance(self.count)
        # Whether a model adapts may depend on its parameters or its training.
        if chosen is None:
            raise cannot_adapt(plan.components.model.label)
        self.chosen = chosen

    def record(self, predictions: Predictions) -> dict[str, Any]:  # noqa: ARG002
        """Return the frames of the tested sensor that the model was shown, and its choices."""
        return _tested_sensor([self.count], [{"shots": self.count, **self.chosen}])


class FewShotEvaluation(Evaluation):
    """The test of a model on another sensor, once for each number of its labelled frames.

    Attributes:
        counts: Numbers of labelled frames; (0,) for a model that cannot adapt.
        frames: Labelled frames of the tested sensor.
        labels: True answers to these frames.
        adapted: What the model chose after each number; empty for a model that cannot adapt.
    """

    def __init__(self, plan: RunPlan, model: Model, test: TestFrames, reporter: Reporter) -> None:
        super().__init__(plan, model, test, reporter)
        self.counts: tuple[int, ...] = (0,)
        self.frames: Sequence[Frame] = ()
        self.labels: Sequence[Answer] = ()
        self.adapted: list[dict[str, Any]] = []
        transfer, few_shot = plan.spec.transfer, plan.frames.few_shot
        if model.adapt([], []) is not None and transfer is not None and few_shot is not None:
            presses = open_frames(few_shot, reporter)
            self.counts = transfer.shots
            self.frames, self.labels = presses.frames, true_answers(plan.spec, [presses])

    def predict(self) -> Predictions:
        """Return the answers after each number of labelled frames, one number after the other.

        The heatmaps are those without labelled frames. The model is left as it was trained.
        """
        frames = self.test.frames
        answers: Answers = []
        heat: HeatMaps | None = None
        with self.reporter.task("predict", len(frames) * len(self.counts)) as advance:
            for count in self.counts:
                chosen = self.model.adapt(self.frames[:count], self.labels[:count])
                if chosen is not None:
                    self.adapted.append({"shots": count, **chosen})
                predicted, maps = predict_frames(self.model, frames, self.rules, advance)
                answers += predicted
                heat = maps if count == 0 else heat
        self.model.adapt([], [])
        return Predictions.of(answers, heat, self.kind)

    def truth(self) -> Arrays:
        """Return the true answers once for each number of labelled frames."""
        test, source = self.test, self.plan.frames.source
        return few_shot_truth(source, test.truth, test.clusters, self.counts)

    def record(self, predictions: Predictions) -> dict[str, Any]:  # noqa: ARG002
        """Return the frames of the tested sensor that the model was shown, and its choices."""
        frames = self.plan.frames
        return _tested_sensor(
            list(self.counts),
            self.adapted,
            left_out_calibrated=frames.calibrated,
            described=(frames.test_identity or {}).get("describe", {}),
        )


def _tested_sensor(counts: list[int], adapted: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    """Return the entry of a record for what a model saw of the tested sensor, with its rest."""
    seen = {"rest_image": True, "unlabelled_frames": 0, "labelled_frames": counts}
    return {"of_tested_sensor": {**seen, **more, "adapted": adapted}}


def few_shot_truth(
    source: FrameSource, answers: Sequence[Answer], clusters: Sequence[str], counts: Sequence[int]
) -> Arrays:
    """Return ``truth_arrays`` of all test frames once for each number of labelled frames.

    The number is the group of the frames.

    Args:
        source: Source of the frames.
        answers: True answer to every test frame.
        clusters: Press that every test frame belongs to.
        counts: Numbers of labelled frames.
    """
    groups = [str(count) for count in counts for _ in answers]
    times = len(counts)
    return truth_arrays(source, [*answers] * times, [*clusters] * times, groups)


class FoldedEvaluation(Evaluation):
    """The test of a model that is trained anew for each fold of the test frames.

    The weights of the run itself, which are timed, learned from all trials.
    """

    def predict(self) -> Predictions:
        """Return the answers to the folds, each by a model that did not learn from it."""
        answers: Answers = []
        for fold, presses in zip(self.plan.frames.folds, self.test.sets, strict=True):
            model, _ = train_model(self.plan.of_fold(fold), self.reporter)
            with self.reporter.task("predict", len(presses)) as advance:
                answers += predict_frames(model, presses.frames, self.rules, advance)[0]
        return Predictions.of(answers, None, self.kind)


class HardCaseEvaluation(Evaluation):
    """The test of a model on frames on which it may fail.

    It is not timed: the weights are those of other protocols, which time them.
    """

    def predict(self) -> Predictions:
        """Return the answers, with no contacts where the model failed, and the failures."""
        frames = self.test.frames
        with self.reporter.task("predict", len(frames)) as advance:
            answers, failures = predict_or_fail(self.model, frames, self.rules, advance)
        answered = Predictions.of(answers, None, self.kind).arrays
        return Predictions({**answered, **failures}, {})

    def time(self) -> Speed:
        """Return no times."""
        return Speed()

    def examples(self) -> Arrays:
        """Return the first frame of every case."""
        first = {group: row for row, group in reversed(list(enumerate(self.test.groups)))}
        return example_arrays(self.test.frames, sorted(first.values()))

    def record(self, predictions: Predictions) -> dict[str, Any]:
        """Return the number of frames on which the model failed, and the causes."""
        return {"failures": failures_record(predictions.arrays, self.test.groups)}


def predict_or_fail(
    model: Model, frames: Sequence[Frame], rules: AnswerRules, advance: Any
) -> tuple[Answers, Arrays]:
    """Return the answers of ``predict_frames``, and the frames on which the model failed.

    The answer to such a frame has no contacts. An exception that does not come from the model, such
    as an interruption, is not caught.

    The arrays for F such frames are failed (F,), their rows, raised (F,), whether an exception was
    raised, else a number was not finite, and cause (F,), type and message of the exception.

    Args:
        model: The trained model.
        frames: Test frames.
        rules: Limits of the answers.
        advance: Function that is called after every frame.
    """
    answers: Answers = []
    failures: list[tuple[int, bool, str]] = []
    for row, frame in enumerate(frames):
        try:
            predicted, _ = predict_frames(model, [frame], rules, lambda _: None)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin's
            raised = not isinstance(error, NotFiniteError)
            failures.append((row, raised, failure_cause(error)))
            predicted = [Contacts.none()]
        answers += predicted
        advance(1)
    rows, raised_by_row, causes = zip(*failures, strict=True) if failures else ((), (), ())
    return answers, {
        "failed": np.array(rows, dtype=np.int64),
        "raised": np.array(raised_by_row, dtype=bool),
        "cause": np.array(causes, dtype=np.str_),
    }


def failures_record(arrays: Mapping[str, Any], groups: Sequence[str]) -> dict[str, Any]:
    """Return the number of failed frames, and causes with their first case and number of frames.

    Args:
        arrays: Arrays of failures, see ``predict_or_fail``.
        groups: Group of every test frame.
    """
    causes: dict[str, dict[str, Any]] = {}
    for row, cause in zip(arrays["failed"].tolist(), arrays["cause"].tolist(), strict=True):
        entry = causes.setdefault(cause, {"cause": cause, "first": groups[row], "frames": 0})
        entry["frames"] += 1
    return {"frames": len(arrays["failed"]), "causes": list(causes.values())[:MOST_CAUSES]}
