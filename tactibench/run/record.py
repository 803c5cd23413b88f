"""The record of a run: what was asked, what it was made from, what came out."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tactibench import __version__
from tactibench.records.files import arrays_hash
from tactibench.records.identity import code_commit
from tactibench.records.record import SCHEMA
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
    metrics: list[dict[str, Any]],
    predicted: Arrays,
    *,
    data: list[str],
    account: dict[str, dict[str, int]],
    presses: int,
    shots: dict[str, Any],
) -> dict[str, Any]:
    """JSON values for ``write_run``.

    predicted: as packed. data: hashes of the test frames. account: by role, how the sensor made
    its scenes (see ``Sensor.scene_counts``). presses: how many the test frames are of. shots: what
    of the tested sensor was shown beforehand, where that is another one.
    """
    protocol, request, parts = plan.protocol, plan.request, plan.parts
    environment = environment_facts()
    report = trained.report
    encoder = parts.encoder
    return {
        "schema": SCHEMA,
        "name": plan.name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "protocol": {
            "id": protocol.keys.id,
            "version": protocol.keys.version,
            "hash": protocol.hash,
            "title": protocol.keys.title,
        },
        "model": {"name": parts.model.name, "parameters": dict(parts.model.values)},
        "regime": parts.regime,
        "encoder": None
        if encoder is None
        else {"name": encoder.name, "parameters": dict(encoder.values)},
        "sensor": {
            "name": parts.sensor.name,
            "origin": parts.sensor.spec.origin,
            "parameters": dict(parts.sensor.values),
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
        },
        "environment": environment,
        "metrics": metrics,
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
        "signature": signature(plan, trained, environment["fingerprint"]),
    }


def signature(plan: RunPlan, trained: Trained, machine: str) -> str:
    """One line that makes the numbers above it reproducible."""
    fields = {
        "protocol": f"{plan.protocol.label}+{plan.protocol.hash[:8]}",
        "model": plan.parts.model.label(),
        "regime": plan.parts.regime,
        "encoder": plan.parts.encoder.label() if plan.parts.encoder else "none",
        "sensor": plan.parts.sensor.label(),
        "seed": plan.request.seed,
        **({"presses": plan.request.presses} if plan.request.presses is not None else {}),
        **({"test": ",".join(plan.request.tested.texts)} if plan.request.tested else {}),
        "weights": trained.hash[:8],
        "partial": "yes" if plan.request.partial else "no",
        "machine": machine,
        "version": __version__,
    }
    return "|".join(f"{name}:{value}" for name, value in fields.items())
