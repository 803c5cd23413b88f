"""A run: frames, weights, raw predictions, raw times, and only then the score."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import chdir
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts
from tactibench.frames import Presses
from tactibench.plugins import SensorContext
from tactibench.records import (
    SCHEMA,
    Arrays,
    Record,
    StoredRun,
    arrays_hash,
    code_commit,
    held_name,
    make_signature,
    readable_run,
    unscored_run,
    write_answers,
)
from tactibench.run.components import Sensor, describe_target
from tactibench.run.evaluation import Evaluation, TestFrames
from tactibench.run.machine import environment_facts, limited_threads
from tactibench.run.plan import RunPlan
from tactibench.run.predict import Predictions
from tactibench.run.reporter import Reporter
from tactibench.run.request import TestOptions, folder_label
from tactibench.run.score import score_answers
from tactibench.run.timing import Speed
from tactibench.run.weights import TrainedWeights, train_model

FLOOR = frozenset({"surface_floor_mm", "surface_excess_mm"})
"""Metrics that need the floor of the encoder."""
SURFACE = FLOOR | {"surface_rmse_mm"}
"""Metrics that need the true surfaces."""


def execute(
    plan: RunPlan, reporter: Reporter, *, fresh: bool = False, timed: bool = True
) -> StoredRun:
    """Return the run of a plan from the store, or carry the plan out and store the run.

    Interrupted work is continued by the same call. The name of the run is held meanwhile. So a
    store that cannot be written is told before the training, and another process that makes the
    same run waits and takes it.

    Args:
        plan: The plan of the run.
        reporter: Shows the work.
        fresh: Whether to make everything anew: frames, weights, answers and times.
        timed: Whether to measure how long an answer takes; many runs of one model need that once.

    Raises:
        UserError: Before any work: a metric does not exist or does not fit. Later: the model
            answers something else than it declared, or the answers cannot be scored.
    """
    store, name = plan.store, plan.name
    if not fresh and (done := readable_run(store, name)) is not None:
        return done
    from tactibench.metrics import check_metrics

    check_metrics(plan.protocol)
    with held_name(store, name):
        if not fresh and (done := readable_run(store, name)) is not None:
            return done  # another process made it meanwhile
        answers = None if fresh else unscored_run(store, name)
        if answers is None:
            with chdir("."):  # a plugin may leave it
                answered = _answer(plan, reporter, fresh=fresh, timed=timed)
            answers = write_answers(store, *answered)
        with reporter.task("score", 1):
            return score_answers(answers, plan.protocol)


def _answer(
    plan: RunPlan, reporter: Reporter, *, fresh: bool, timed: bool
) -> tuple[Record, dict[str, Arrays]]:
    """Return the record of a run that is not scored yet, and its arrays."""
    model, weights = train_model(plan, reporter, fresh=fresh)
    test = TestFrames.open(plan, reporter)
    evaluation = _evaluation(plan)(plan, model, test, reporter)
    with limited_threads(1):  # as in training: an answer does not depend on the number of threads
        predictions = evaluation.predict()
    truth, maps = evaluation.truth(), predictions.maps
    if "force" not in predictions.arrays:
        truth.pop("force", None)
    if plan.frames.source.simulates:
        _add_simulated_truth(plan, test, truth, maps, reporter)
    if plan.published:
        from tactibench.run.published_predictions import published_arrays

        truth |= published_arrays(plan.published, plan.protocol.test_frames, test.names, test.truth)
    speed = evaluation.time() if timed else Speed()
    record = _make_record(plan, weights, evaluation, predictions, speed)
    arrays = {
        "truth": truth,
        "predictions": predictions.arrays,
        "maps": maps,
        "times": speed.raw,
        "examples": evaluation.examples(),
    }
    return record, arrays


def _evaluation(plan: RunPlan) -> type[Evaluation]:
    """Return the class of the test that a plan needs."""
    frames = plan.frames
    if not (plan.spec.transfer or frames.few_shot or plan.spec.families or frames.folds):
        return Evaluation
    from tactibench.run import special_evaluations as special

    if frames.folds:
        return special.FoldedEvaluation

    if plan.spec.transfer is not None:
        return special.FewShotEvaluation
    return special.AdaptedEvaluation if plan.request.test.shots else special.HardCaseEvaluation


def _add_simulated_truth(
    plan: RunPlan, test: TestFrames, truth: Arrays, maps: Arrays, reporter: Reporter
) -> None:
    """Add the ground truth that only a simulator has, for the metrics that need it.

    These are the true surfaces and the encoder's floor for heatmaps, Cramer-Rao bounds, and
    two-point limits for a threshold.
    """
    from tactibench.frames import true_bounds, true_limits, true_surfaces

    names, grid, sets = plan.spec.metrics.names, plan.spec.grid.grid(), test.sets[: test.main]
    context = SensorContext(np.random.SeedSequence(plan.spec.data_seed))
    with plan.components.tested.build(context) as sensor:
        if SURFACE & {*names} and plan.components.shows_surface and maps:
            surfaces = _join_sets(
                "true surfaces",
                sets,
                lambda presses: true_surfaces(sensor, presses, grid),
                reporter,
            )
            if surfaces is not None:
                maps["surface"] = surfaces
            encoder = plan.scoring_encoder()
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
                array = _join_sets(title, sets, partial(find, sensor), reporter)
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


def _make_record(
    plan: RunPlan,
    weights: TrainedWeights,
    evaluation: Evaluation,
    predictions: Predictions,
    speed: Speed,
) -> Record:
    """Return the record for ``write_answers``, whose metrics follow when the answers are scored.

    Args:
        plan: The plan of the run.
        weights: The trained weights.
        evaluation: The test.
        predictions: The answers to the test frames.
        speed: Times and cost of the model.
    """
    spec, request, components, frames = plan.spec, plan.request, plan.components, plan.frames
    report = weights.report
    values = {
        "schema": SCHEMA,
        "name": plan.name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "protocol": {
            "id": spec.id,
            "version": spec.version,
            "hash": plan.protocol.hash,
            "title": spec.title,
        },
        "model": components.model.component.json_values(),
        "regime": components.regime,
        "encoder": components.encoder and components.encoder.component.json_values(),
        "sensor": _sensor(plan, evaluation),
        "seed": request.seed,
        "partial": request.partial,
        "limits": {
            "quick": request.quick,
            "limit": request.limit,
            "presses": request.presses,
        },
        "identity": {
            **plan.identity,
            "commit": code_commit(Path(__file__).resolve().parents[2]),
            "data": [presses.hash for presses in evaluation.test.sets],
            "weights_hash": weights.hash,
            "predictions_hash": arrays_hash(predictions.arrays),
            "stored": {},
        },
        "environment": environment_facts(),
        "metrics": [],
        "speed": speed.rows,
        "efficiency": {**speed.efficiency, "training_s": report["seconds"]},
        "training": {
            "epochs": report["epochs"],
            "seconds": report["seconds"],
            "presses": frames.count("fit"),
            "device": plan.device,
            "reused": weights.reused,
            "history": report["history"],
            "notes": report["notes"],
            "prior": plan.shipped_prior() or report.get("prior"),
        },
        "data": {
            "train": frames.count("fit"),
            "validation": frames.count("validation"),
            "test": frames.count("test"),
            "rejected": frames.rejected,
            "published_frames": frames.source.published,
            **_simulator_errors(plan),
            **evaluation.record(predictions),
        },
        "signature": "",
    }
    record = Record.model_validate(values)
    record.signature = make_signature(record)
    return record


def _simulator_errors(plan: RunPlan) -> dict[str, Any]:
    """Return the simulator's own errors by test set.

    A quick run states none, and there are none of real and finite-element frames.
    """
    tested = plan.components.tested.spec
    if tested.origin != "simulated" or tested.reference_of or plan.request.quick:
        return {}
    from tactibench.frames import simulator_error

    errors = [simulator_error(frames) for frames in plan.frames.test]
    return {"simulator": [error for error in errors if error is not None]}


def _sensor(plan: RunPlan, evaluation: Evaluation) -> dict[str, Any]:
    sensor, tested, options = plan.components.sensor, plan.components.test_sensor, plan.request.test
    described = plan.frames.sensor_identity["describe"]
    # A recording of a simulator or of emulators states that: its row is no row of a real sensor.
    origin = "simulated" if described.get("origin") == "simulated" else sensor.spec.origin
    values = {**sensor.component.json_values(), "origin": origin}
    if sensor.spec.needs_data and {"folder", "sha256"} <= set(described):
        values["recording"] = {
            "label": described["folder"],
            "sha256": described["sha256"],
            "sensor": str(described.get("recorded_with", "")),
        }
    if (space := plan.frames.source.workspace) is not None:
        radius = None if math.isinf(space.dome_radius_mm) else space.dome_radius_mm
        known = {name: v for name, v in asdict(space).items() if not math.isnan(v)}
        gate = plan.frames.source.gate_mm
        values["range"] = {**known, "dome_radius_mm": radius, "gate_mm": gate}
    if tested is not None:
        presses = len(set(evaluation.test.clusters))
        values["tested"] = target_record(tested, sensor, options, presses, plan.request.data)
    return values


def target_record(
    tested: Sensor, sensor: Sensor, options: TestOptions, presses: int, data: Path | None
) -> dict[str, Any]:
    """Return the entry of the tested sensor in the record.

    Args:
        tested: The sensor that presses the test scenes.
        sensor: The sensor that pressed the training scenes.
        options: The options of ``--test``.
        presses: Number of presses of the test frames.
        data: Folder of the training frames.
    """
    record = {
        "name": tested.name,
        "parameters": dict(tested.values),
        "asked": options.texts,
        "on": describe_target(tested, options),
        "presses": presses,
    }
    if options.data is not None:
        trained_on = sensor.label if data is None else f"recording {folder_label(data)}"
        record["trained_on"] = f"{sensor.spec.origin} {trained_on}"
    return record
