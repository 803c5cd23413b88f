"""One run: frames, weights, raw predictions, raw times, and only then the score."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tactibench import __version__
from tactibench.contacts import Answer, Frame
from tactibench.datasets.known import true_bounds, true_surfaces
from tactibench.datasets.presses import Presses
from tactibench.plugins.interfaces import Progress, SensorContext
from tactibench.records.answers import pack
from tactibench.records.files import arrays_hash
from tactibench.records.identity import code_commit
from tactibench.records.record import SCHEMA
from tactibench.records.store import Arrays, StoredRun, write_run
from tactibench.running.frames import Wanted
from tactibench.running.plan import RunPlan
from tactibench.running.predictions import predict_all, predicted_maps
from tactibench.running.scoring import score_arrays
from tactibench.running.speed import Speed, measure_speed
from tactibench.running.weights import Trained, trained_weights
from tactibench.timing.fingerprint import fingerprint, fingerprint_hash

EXAMPLES = 24
"""Test frames kept with a run, so that pictures need no sensor."""
QUICK_CALLS, CALLS = 60, 300


class Reporter(Protocol):
    """Shows long work. ``task`` gives a function that is told of finished items."""

    def task(self, title: str, total: int) -> AbstractContextManager[Callable[[int], None]]: ...

    def training(self) -> AbstractContextManager[Progress]: ...


@dataclass(frozen=True)
class TestData:
    """The test frames of a run with their truth and groups, in order."""

    __test__ = False  # not a test case, whatever its name

    presses: tuple[Presses, ...]
    frames: tuple[Frame, ...]
    truth: tuple[Answer, ...]
    names: tuple[str, ...]
    groups: tuple[str, ...]


def execute(plan: RunPlan, store: Path, reporter: Reporter) -> StoredRun:
    """Carry a plan out and store the run. Interrupted work is continued by the same call."""
    model = plan.parts.build_model(plan.context())
    with reporter.training() as progress:
        trained = trained_weights(plan.weights, model, lambda role: _examples(plan, role, reporter), progress)
    test = _test_data(plan, reporter)
    keys = plan.protocol.keys
    with reporter.task("predict", len(test.frames)) as advance:
        answers = predict_all(
            model, test.frames, keys.answer, plan.parts.model.spec.max_contacts, advance  # type: ignore[union-attr]
        )  # fmt: skip
    wants_surface = "surface_rmse_mm" in keys.metrics.names
    shape = (keys.grid.cells, keys.grid.cells)
    maps: Arrays = {}
    heat = predicted_maps(model, test.frames, shape) if keys.answer == "contacts" else None
    if heat is not None:
        maps["maps"] = heat
    truth: Arrays = {
        **pack(test.truth, keys.answer),
        "press": np.array(test.names),
        "group": np.array(test.groups),
    }
    if not plan.parts.sensor.spec.needs_data:  # type: ignore[union-attr]
        _add_known(plan, test, reporter, truth, maps, surface=wants_surface and heat is not None)
    with reporter.task("time", 1) as advance:
        calls = QUICK_CALLS if plan.request.quick else CALLS
        speed = measure_speed(model, test.frames, answers, calls)
        advance(1)
    predicted = pack(answers, keys.answer)
    metrics = score_arrays(keys, truth, predicted, maps)
    parts = {
        "truth": truth,
        "predictions": predicted,
        "maps": maps,
        "times": speed.raw,
        "examples": _pictures(test),
    }
    record = _record(plan, trained, speed, metrics, test, parts)
    return write_run(store, record, parts)


def _examples(
    plan: RunPlan, role: str, reporter: Reporter
) -> tuple[Sequence[Frame], Sequence[Answer]]:
    frames: list[Frame] = []
    truth: list[Answer] = []
    wanted = plan.frames.fit if role == "fit" else plan.frames.validation
    for one in wanted:
        presses = _open(one, reporter)
        frames += presses.frames
        truth += presses.truth(plan.protocol.keys.answer, plan.protocol.keys.workspace.dome_radius_mm)
    return frames, truth


def _test_data(plan: RunPlan, reporter: Reporter) -> TestData:
    keys = plan.protocol.keys
    opened = tuple(_open(one, reporter) for one in plan.frames.test)
    return TestData(
        opened,
        tuple(frame for presses in opened for frame in presses.frames),
        tuple(
            answer
            for presses in opened
            for answer in presses.truth(keys.answer, keys.workspace.dome_radius_mm)
        ),
        tuple(name for presses in opened for name in presses.names),
        tuple(group for one in plan.frames.test for group in one.groups),
    )


def _open(wanted: Wanted, reporter: Reporter) -> Presses:
    verb = "open" if wanted.cached else "generate"
    with reporter.task(f"{verb} {wanted.name} ({wanted.role})", len(wanted.scenes)) as advance:
        return wanted.open(advance)


def _add_known(
    plan: RunPlan,
    test: TestData,
    reporter: Reporter,
    truth: Arrays,
    maps: Arrays,
    *,
    surface: bool,
) -> None:
    """What only a simulator can add: true surfaces and Cramer-Rao bounds."""
    keys = plan.protocol.keys
    with plan.parts.build_sensor(SensorContext(np.random.SeedSequence(keys.data_seed))) as sensor:
        if surface:
            with reporter.task("true surfaces", len(test.presses)) as advance:
                known = []
                for presses in test.presses:
                    known.append(true_surfaces(sensor, presses, keys.grid.grid()))
                    advance(1)
            if all(one is not None for one in known):
                maps["surface"] = np.concatenate([one for one in known if one is not None])
        if "rmse_over_bound" in keys.metrics.names:
            with reporter.task("Cramer-Rao bounds", len(test.presses)) as advance:
                bounds = []
                for presses in test.presses:
                    bounds.append(true_bounds(sensor, presses))
                    advance(1)
            if all(one is not None for one in bounds):
                truth["bound"] = np.concatenate([b for one in bounds if one for b in one])


def _pictures(test: TestData) -> Arrays:
    count = len(test.frames)
    index = np.unique((np.arange(min(EXAMPLES, count)) + 0.5) * count / min(EXAMPLES, count))
    rows = index.astype(np.int64)
    return {"index": rows, "images": np.stack([test.frames[i].image for i in rows])}


def _record(
    plan: RunPlan,
    trained: Trained,
    speed: Speed,
    metrics: list[dict[str, Any]],
    test: TestData,
    parts: dict[str, Arrays],
) -> dict[str, Any]:
    protocol, request = plan.protocol, plan.request
    environment = environment_facts()
    report = trained.report
    identity = {
        **plan.identity,
        "commit": code_commit(Path(__file__).resolve().parents[2]),
        "data": [presses.hash for presses in test.presses],
        "weights_hash": trained.hash,
        "predictions_hash": arrays_hash(parts["predictions"]),
    }
    record: dict[str, Any] = {
        "schema": SCHEMA,
        "name": plan.name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "protocol": {
            "id": protocol.keys.id,
            "version": protocol.keys.version,
            "hash": protocol.hash,
            "title": protocol.keys.title,
        },
        "model": {"name": plan.parts.model.name, "parameters": dict(plan.parts.model.values)},
        "regime": plan.parts.regime,
        "encoder": None
        if plan.parts.encoder is None
        else {
            "name": plan.parts.encoder.name,
            "parameters": dict(plan.parts.encoder.values),
        },
        "sensor": {
            "name": plan.parts.sensor.name,
            "origin": plan.parts.sensor.spec.origin,  # type: ignore[union-attr]
            "parameters": dict(plan.parts.sensor.values),
        },
        "seed": request.seed,
        "partial": request.partial,
        "limits": {"quick": request.quick, "limit": request.limit},
        "identity": identity,
        "environment": environment,
        "metrics": metrics,
        "speed": speed.rows,
        "timed": speed.timed,
        "training": {
            "epochs": report["epochs"],
            "seconds": report["seconds"],
            "presses": plan.frames.count("fit"),
            "reused": trained.reused,
            "history": report["history"],
            "notes": report["notes"],
        },
        "data": {
            "train": plan.frames.count("fit"),
            "validation": plan.frames.count("validation"),
            "test": len(test.frames),
            "rejected": plan.frames.rejected,
        },
        "signature": signature(plan, trained, environment["fingerprint"]),
    }
    return record


def signature(plan: RunPlan, trained: Trained, machine: str) -> str:
    """One line that makes the numbers above it reproducible."""
    fields = {
        "protocol": f"{plan.protocol.label}+{plan.protocol.hash[:8]}",
        "model": plan.parts.model.label(),
        "regime": plan.parts.regime,
        "encoder": plan.parts.encoder.label() if plan.parts.encoder else "none",
        "sensor": plan.parts.sensor.label(),
        "seed": plan.request.seed,
        "weights": trained.hash[:8],
        "partial": "yes" if plan.request.partial else "no",
        "machine": machine,
        "version": __version__,
    }
    return "|".join(f"{name}:{value}" for name, value in fields.items())


def environment_facts() -> dict[str, Any]:
    """The machine and the versions that a reader needs to judge or repeat a run."""
    from importlib.metadata import version

    found = fingerprint(with_torch=True)
    packages = ("numpy", "scipy", "torch", "opencv-contrib-python-headless", "tactibench")
    versions = {}
    for package in packages:
        try:
            versions[package] = version(package)
        except ModuleNotFoundError:
            versions[package] = "not installed"
    return {
        **found,
        "fingerprint": fingerprint_hash(found),
        "threads": int(os.environ.get("OMP_NUM_THREADS", found["cores_logical"] or 1)),
        "versions": versions,
    }
