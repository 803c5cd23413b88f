"""A run: frames, weights, raw predictions, raw times, and only then the score."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts
from tactibench.frames import Presses, true_bounds, true_limits, true_surfaces
from tactibench.metrics import check_metrics
from tactibench.plugins import SensorContext
from tactibench.records import Arrays, Record, StoredRun, held_name, unscored_run, write_answers
from tactibench.run.evaluation import Evaluation, TestFrames
from tactibench.run.plan import RunPlan
from tactibench.run.predict import cached_predictions
from tactibench.run.record import make_record
from tactibench.run.reporter import Reporter
from tactibench.run.score import score_answers
from tactibench.run.timing import Speed
from tactibench.run.train import train_model

FLOOR = frozenset({"surface_floor_mm", "surface_excess_mm"})
"""Metrics that need the floor of the encoder."""
SURFACE = FLOOR | {"surface_rmse_mm"}
"""Metrics that need the true surfaces."""


def execute(
    plan: RunPlan, store: Path, reporter: Reporter, *, fresh: bool = False, timed: bool = True
) -> StoredRun:
    """Carry a plan out and store the run. Interrupted work is continued by the same call.

    Args:
        plan: The plan of the run.
        store: Folder of the run store.
        reporter: Shows the work.
        fresh: Whether to predict again even if predictions for these frames are in the cache.
        timed: Whether to measure how long an answer takes; many runs of one model need that once.

    Raises:
        UserError: Before any work: a metric does not exist or does not fit. Later: the model
            answers something else than it declared, or the answers cannot be scored.
    """
    check_metrics(plan.protocol)
    if not fresh and unscored_run(store, plan.name) is not None:
        with held_name(store, plan.name):
            waiting = unscored_run(store, plan.name)  # unless another process scored it
            if waiting is not None:
                return _scored(waiting, plan, reporter)
    record, arrays = _answer(plan, reporter, fresh=fresh, timed=timed)
    # Held until the run has its name: another process may have the same answers by now.
    with held_name(store, plan.name):
        return _scored(write_answers(store, record, arrays), plan, reporter)


def _scored(answers: StoredRun, plan: RunPlan, reporter: Reporter) -> StoredRun:
    with reporter.task("score", 1):
        return score_answers(answers, plan.protocol)


def _answer(
    plan: RunPlan, reporter: Reporter, *, fresh: bool, timed: bool
) -> tuple[Record, dict[str, Arrays]]:
    """Return the record of a run that is not scored yet, and its arrays."""
    model, weights = train_model(plan, reporter)
    test = TestFrames.open(plan, reporter)
    evaluation = _evaluation(plan)(plan, model, test, reporter)
    predictions = cached_predictions(
        plan.predictions_file, weights.hash, evaluation.predict, fresh=fresh
    )
    truth, maps = evaluation.truth(), predictions.map_arrays
    if plan.frames.source.simulates:
        _add_simulated_truth(plan, test, truth, maps, reporter)
    if plan.published:
        from tactibench.run.published_predictions import published_arrays

        truth |= published_arrays(plan.published, plan.protocol.test_frames, test.names, test.truth)
    speed = evaluation.time(predictions) if timed else Speed()
    record = make_record(plan, weights, evaluation, predictions, speed)
    arrays = {
        "truth": truth,
        "predictions": predictions.arrays,
        "maps": maps,
        "times": speed.raw,
        "examples": evaluation.examples(),
    }
    return record, arrays


def _evaluation(plan: RunPlan) -> type[Evaluation]:
    """Return the class of the test that a plan needs; only its module is imported."""
    if plan.spec.transfer is not None:
        from tactibench.run.few_shot import FewShotEvaluation

        return FewShotEvaluation
    if plan.request.test.shots:
        from tactibench.run.few_shot import AdaptedEvaluation

        return AdaptedEvaluation
    if plan.spec.families:
        from tactibench.run.hard_cases import HardCaseEvaluation

        return HardCaseEvaluation
    return Evaluation


def _add_simulated_truth(
    plan: RunPlan, test: TestFrames, truth: Arrays, maps: Arrays, reporter: Reporter
) -> None:
    """Add the ground truth that only a simulator has, for the metrics that need it.

    These are the true surfaces and the encoder's floor for heatmaps, Cramer-Rao bounds, and
    two-point limits for a threshold.
    """
    names, grid = plan.spec.metrics.names, plan.spec.grid.grid()
    context = SensorContext(np.random.SeedSequence(plan.spec.data_seed))
    with plan.components.tested.build(context) as sensor:
        if SURFACE & {*names} and plan.components.shows_surface and maps:
            surfaces = _join_sets(
                "true surfaces",
                test.sets[: test.main],
                lambda presses: true_surfaces(sensor, presses, grid),
                reporter,
            )
            if surfaces is not None:
                maps["surface"] = surfaces
            encoder = plan.components.build_encoder()
            if surfaces is not None and encoder is not None and FLOOR & {*names}:
                from tactibench.metrics import surface_floor

                depth = plan.spec.workspace.depth_max_mm
                contacts = [answer for answer in test.truth if isinstance(answer, Contacts)]
                main = contacts[: len(surfaces)]
                maps["floor"] = surface_floor(encoder, main, surfaces, grid, depth)
        simulated = (
            ("rmse_over_bound", "bound", "Cramer-Rao bounds", true_bounds),
            ("threshold_mm", "limit", "two-point limits", true_limits),
        )
        for metric, name, title, find in simulated:
            if metric in names:
                array = _join_sets(title, test.sets[: test.main], partial(find, sensor), reporter)
                if array is not None:
                    truth[name] = array


def _join_sets(
    title: str,
    sets: Sequence[Presses],
    compute: Callable[[Presses], npt.NDArray[Any] | None],
    reporter: Reporter,
) -> npt.NDArray[Any] | None:
    """Return the arrays of all sets, joined; None when the sensor does not know one of them.

    Args:
        title: Title of the task that the reporter shows.
        sets: Presses.
        compute: Function from presses to their array.
        reporter: Shows the work.
    """
    arrays = []
    with reporter.task(title, len(sets)) as advance:
        for presses in sets:
            array = compute(presses)
            if array is None:
                return None
            arrays.append(array)
            advance(1)
    return np.concatenate(arrays)
