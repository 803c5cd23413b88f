"""The record of a run: what was asked, what it was made from, what came out."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tactibench.records.files import arrays_hash
from tactibench.records.identity import code_commit
from tactibench.records.record import SCHEMA, Metric, Record, make_signature
from tactibench.records.store import Arrays
from tactibench.run.environment import environment_facts
from tactibench.run.plan import RunPlan
from tactibench.run.test_sensor import tested_record
from tactibench.run.timing import Speed
from tactibench.run.weights import Trained


def make_record(
    plan: RunPlan,
    trained: Trained,
    speed: Speed,
    metrics: list[Metric],
    predicted: Arrays,
    *,
    data: list[str],
    account: dict[str, dict[str, int]],
    presses: int,
    shots: dict[str, Any],
) -> Record:
    """Return the record for ``write_run``.

    predicted: as packed. data: hashes of the test frames. account: by role, how the sensor made
    its scenes (see ``Sensor.scene_counts``). presses: how many the test frames are of. shots: what
    of the tested sensor was shown beforehand, where that is another one.
    """
    protocol, request, parts = plan.protocol, plan.request, plan.parts
    environment = environment_facts()
    report = trained.report
    encoder = parts.encoder
    values = {
        "schema": SCHEMA,
        "name": plan.name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "protocol": {
            "id": protocol.keys.id,
            "version": protocol.keys.version,
            "hash": protocol.hash,
            "title": protocol.keys.title,
        },
        "model": parts.model.component().json_values(),
        "regime": parts.regime,
        "encoder": None if encoder is None else encoder.component().json_values(),
        "sensor": {
            **parts.sensor.component().json_values(),
            "origin": parts.sensor.spec.origin,
            **({"account": account} if account else {}),
            **tested_record(parts, request.tested, presses, request.data),
        },
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
            "data": data,
            "weights_hash": trained.hash,
            "predictions_hash": arrays_hash(predicted),
            "stored": {},
        },
        "environment": environment,
        "metrics": [row.json_values() for row in metrics],
        "speed": speed.rows,
        "timed": speed.timed,
        "efficiency": {**speed.efficiency, "training_s": report["seconds"]},
        "training": {
            "epochs": report["epochs"],
            "seconds": report["seconds"],
            "presses": plan.frames.count("fit"),
            "device": plan.device,
            "reused": trained.reused,
            "history": report["history"],
            "notes": report["notes"],
        },
        "data": {
            "train": plan.frames.count("fit"),
            "validation": plan.frames.count("validation"),
            "test": plan.frames.count("test"),
            "rejected": plan.frames.rejected,
            "published_frames": plan.frames.published,
            **shots,
        },
        "signature": "",
    }
    record = Record.model_validate(values)
    record.signature = make_signature(record)
    return record
