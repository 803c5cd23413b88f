"""The record of a run: its request, everything that it was made from, and its results."""

from __future__ import annotations

import math
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tactibench.frames import simulator_error
from tactibench.records import SCHEMA, Record, arrays_hash, code_commit, make_signature
from tactibench.run.evaluation import Evaluation
from tactibench.run.machine import environment_facts
from tactibench.run.plan import RunPlan
from tactibench.run.predict import Predictions
from tactibench.run.timing import Speed
from tactibench.run.weights import TrainedWeights


def make_record(
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
        "timed": speed.timed,
        "efficiency": {**speed.efficiency, "training_s": report["seconds"]},
        "training": {
            "epochs": report["epochs"],
            "seconds": report["seconds"],
            "presses": frames.count("fit"),
            "device": plan.device,
            "reused": weights.reused,
            "history": report["history"],
            "notes": report["notes"],
            "prior": report.get("prior"),
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
    """Return the simulator's own errors by test set; {} for real and finite-element frames."""
    tested = plan.components.tested.spec
    if tested.origin != "simulated" or tested.reference_of:
        return {}
    errors = [simulator_error(frames) for frames in plan.frames.test]
    return {"simulator": [error for error in errors if error is not None]}


def _sensor(plan: RunPlan, evaluation: Evaluation) -> dict[str, Any]:
    sensor, tested = plan.components.sensor, plan.components.test_sensor
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
    if (space := plan.frames.workspace) is not None:
        radius = None if math.isinf(space.dome_radius_mm) else space.dome_radius_mm
        values["range"] = {**asdict(space), "dome_radius_mm": radius}
    if tested is not None:
        from tactibench.run.test_sensor import target_record

        presses = len(set(evaluation.test.clusters))
        options, data = plan.request.test, plan.request.data
        values["tested"] = target_record(tested, sensor, options, presses, data)
    return values
