"""One run: frames, weights, raw predictions, raw times, and only then the score."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.frames.ground_truth import true_bounds, true_surfaces
from tactibench.frames.presses import Presses
from tactibench.metrics.registry import check_metrics
from tactibench.plugins.base import Model, SensorContext
from tactibench.records.store import Arrays, StoredRun, write_run
from tactibench.run.examples import example_arrays
from tactibench.run.failures import Failures, failures_record
from tactibench.run.few_shot import open_shots
from tactibench.run.plan import RunPlan
from tactibench.run.predict import predict_all
from tactibench.run.prediction_cache import answered
from tactibench.run.published_predictions import released_arrays
from tactibench.run.record import make_record
from tactibench.run.score import score_arrays
from tactibench.run.timing import NOT_TIMED, Speed, measure_speed
from tactibench.run.train import Reporter, open_frames, trained_model
from tactibench.run.truth import true_answers, truth_arrays

QUICK_CALLS, CALLS = 60, 300
QUICK_BUDGET_S = 3.0
"""Seconds a thread count of --quick: a neighbour on the other core must not eat its minute."""


Known = TypeVar("Known")


@dataclass(frozen=True)
class TestData:
    """The test frames of a run with their truth, groups and presses' names, in order."""

    __test__ = False  # not a test case, whatever its name

    presses: tuple[Presses, ...]
    groups: tuple[str, ...]
    truth: tuple[Answer, ...]
    names: tuple[str, ...]

    @property
    def frames(self) -> list[Frame]:
        return [frame for presses in self.presses for frame in presses.frames]


def execute(plan: RunPlan, store: Path, reporter: Reporter, *, fresh: bool = False) -> StoredRun:
    """Carry a plan out and store the run. Interrupted work is continued by the same call.

    fresh: ask the model again, even if its answers to these frames are kept.

    Raises UserError before any work for metrics that do not exist or do not fit.
    """
    keys = plan.protocol.keys
    check_metrics(plan.protocol)
    model, trained = trained_model(plan, reporter)
    test = _test_data(plan, reporter)
    frames = test.frames
    shots = open_shots(plan, model, reporter)
    chosen = shots.chosen(model)
    hard, failures = bool(keys.families), Failures()
    ask = failures.predict_all if hard else predict_all
    with reporter.task("predict", len(frames) * len(shots)) as advance:
        most, shape = plan.parts.model.spec.max_contacts, keys.grid.grid().shape
        found = answered(
            plan.answers_file,
            trained.hash,
            keys.answer,
            lambda: shots.each(
                model, lambda: ask(model, frames, keys.answer, most, shape, advance)
            ),
            fresh=fresh,
            beside=failures.arrays if hard else dict,
        )
    answers, predicted = found.answers(keys.answer)[: len(frames)], found.predicted
    maps: Arrays = {} if found.heat is None else {"maps": found.heat}
    truth = truth_arrays(
        keys,
        shots.repeated(test.truth),
        shots.repeated(test.names),
        shots.groups(test.groups),
    ) | _released(plan, test)
    if not _recorded(plan):
        _add_known(plan, test, reporter, truth, maps)
    speed = NOT_TIMED if hard else _timed(plan, model, test, answers, reporter)
    metrics = score_arrays(keys, truth, predicted, maps)
    record = make_record(
        plan,
        trained,
        speed,
        metrics,
        predicted,
        data=[presses.hash for presses in test.presses],
        account=_account(plan),
        presses=len(set(test.names)),
        shots={**shots.record(plan, chosen), **failures_record(predicted, test.groups)},
    )
    parts = {
        "truth": truth,
        "predictions": predicted,
        "maps": maps,
        "times": speed.raw,
        "examples": example_arrays(frames, test.truth, None, _first_of_each(test.groups))
        if hard
        else example_arrays(frames, test.truth, model),
    }
    return write_run(store, record, parts)


def _timed(
    plan: RunPlan,
    model: Model,
    test: TestData,
    answers: Sequence[Answer | None],
    reporter: Reporter,
) -> Speed:
    with reporter.task("time", 1) as advance:
        if plan.request.quick:
            speed = measure_speed(model, test.frames, answers, QUICK_CALLS, QUICK_BUDGET_S)
        else:
            speed = measure_speed(model, test.frames, answers, CALLS, truth=test.truth)
        advance(1)
    return speed


def _first_of_each(groups: Sequence[str]) -> list[int]:
    """The first frame of every group: of hard cases, one of each is kept."""
    return sorted({group: row for row, group in reversed(list(enumerate(groups)))}.values())


def _released(plan: RunPlan, test: TestData) -> Arrays:
    """What others answered to these frames, kept with the truth so that it is scored again."""
    frames = [name for presses in test.presses for name in presses.names]
    return released_arrays(plan.released, plan.protocol.test_frames, frames, test.truth)


def _test_data(plan: RunPlan, reporter: Reporter) -> TestData:
    opened = tuple(open_frames(wanted, reporter) for wanted in plan.frames.test)
    groups = tuple(group for wanted in plan.frames.test for group in wanted.groups)
    names = tuple(
        name
        for wanted, presses in zip(plan.frames.test, opened, strict=True)
        for name in wanted.presses or presses.names
    )
    return TestData(opened, groups, tuple(true_answers(plan.protocol.keys, opened)), names)


def _add_known(
    plan: RunPlan, test: TestData, reporter: Reporter, truth: Arrays, maps: Arrays
) -> None:
    """What only a simulator can add: true surfaces beside heatmaps, and Cramer-Rao bounds."""
    keys = plan.protocol.keys
    seed = np.random.SeedSequence(keys.data_seed)
    with plan.parts.build_test_sensor(SensorContext(seed)) as sensor:
        scored = "surface_rmse_mm" in keys.metrics.names and plan.parts.shows_surface
        if scored and "maps" in maps:
            grid = keys.grid.grid()
            surfaces = _each(
                reporter,
                "true surfaces",
                test.presses,
                lambda presses: true_surfaces(sensor, presses, grid),
            )
            if surfaces is not None:
                maps["surface"] = np.concatenate(surfaces)
        if "rmse_over_bound" in keys.metrics.names:
            bounds = _each(
                reporter,
                "Cramer-Rao bounds",
                test.presses,
                lambda presses: true_bounds(sensor, presses),
            )
            if bounds is not None:
                truth["bound"] = np.concatenate([bound for one in bounds for bound in one])


def _recorded(plan: RunPlan) -> bool:
    """Whether the test frames were recorded: of them nothing is known but their labels."""
    return plan.parts.test_sensor.spec.needs_data


def _account(plan: RunPlan) -> dict[str, dict[str, int]]:
    """Of every role, how the sensor made its scenes; empty where it has nothing to say."""
    if _recorded(plan):
        return {}
    seed = np.random.SeedSequence(plan.protocol.keys.data_seed)
    sensor, tester = (
        build(SensorContext(seed))
        for build in (plan.parts.build_sensor, plan.parts.build_test_sensor)
    )
    frames = plan.frames
    # Families of hard cases change the sensor: the tester cannot speak for all their scenes.
    tested = () if plan.protocol.keys.families else frames.test
    found = {
        role: dict(one.scene_counts([scene for wanted in sets for scene in wanted.scenes]))
        for role, sets, one in (
            ("fit", frames.fit, sensor),
            ("validation", frames.validation, sensor),
            ("test", tested, tester),
        )
    }
    return {role: counts for role, counts in found.items() if counts}


def _each(
    reporter: Reporter,
    title: str,
    sets: Sequence[Presses],
    known: Callable[[Presses], Known | None],
) -> list[Known] | None:
    """What is known of every set, or None when it is not known of one."""
    found = []
    with reporter.task(title, len(sets)) as advance:
        for presses in sets:
            one = known(presses)
            if one is None:
                return None
            found.append(one)
            advance(1)
    return found
