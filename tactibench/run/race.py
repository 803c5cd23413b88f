"""All ways of one model to compute its answers, timed in one go: ``tactibench speed``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.plugins.base import Model
from tactibench.run.configurations import (
    Configuration,
    Configurations,
    configurations,
    fastest,
)
from tactibench.run.device import machine
from tactibench.run.latency import time_in_rounds, torch_threads
from tactibench.run.latency_rows import speed_rows
from tactibench.run.predict import blinded
from tactibench.run.timing import BATCHES

ROUNDS, OFFLINE_ROUNDS = 10, 9
WAIT_S = 15.0
"""Seconds that the warm-ups of one scenario may take together, and its rounds as many again."""

Advance = Callable[[int], None]


@dataclass(frozen=True)
class Race:
    """What came out. rows: those of a record, each with its configuration's name."""

    found: Configurations
    best: Configuration
    rows: tuple[dict[str, Any], ...]

    def total(self, name: str, threads: int, batch: int = 1, scenario: str = "single") -> Any:
        """The row of the whole call of one configuration; None when it was not timed."""
        wanted = (name, scenario, threads, batch, "total")
        keys = ("configuration", "scenario", "threads", "batch", "phase")
        return next((row for row in self.rows if tuple(row[k] for k in keys) == wanted), None)


def run_race(
    model: Model,
    frames: Sequence[Frame],
    truth: Sequence[Answer],
    *,
    calls: int = 300,
    batches: Sequence[int] | None = None,
    compiled: bool = False,
    advance: Advance = lambda _: None,
) -> Race:
    """Time every configuration that works here: ``single`` with one thread and all, ``offline``.

    Their answers at batch 1 are compared with ``predict``, in float32, and with the truth. The best
    is the one with the lowest median for one frame on one thread among those allowed.
    batches: of ``offline``, None: 1, 8, 32, 128. advance: is told of every finished step.
    """
    seen = [blinded(frame) for frame in frames]
    cores = int(machine()["cores_logical"] or 1)
    with torch_threads(1):
        scored = [model.predict([frame])[0] for frame in seen]
        found = configurations(model, seen, scored, truth, compiled=compiled, advance=advance)
    rows: list[dict[str, Any]] = []
    best = found.usable[0]
    for threads in sorted({1, cores}):
        with torch_threads(threads):
            samples = time_in_rounds(
                found.stages(),
                seen,
                threads=threads,
                calls=max(calls, ROUNDS),
                rounds=ROUNDS,
                budget_s=WAIT_S,
            )
        for name, sample in samples.items():
            rows += [{"configuration": name, **row} for row in speed_rows(sample, "single")]
        if threads == 1:
            best = fastest(found.usable, samples)
        advance(1)
    for batch in BATCHES if batches is None else batches:
        with torch_threads(cores):
            samples = time_in_rounds(
                found.stages(),
                seen,
                batch,
                threads=cores,
                calls=OFFLINE_ROUNDS,
                rounds=OFFLINE_ROUNDS,
                budget_s=WAIT_S / 3,
                block=5 if batch <= 8 else 1,
            )
        for name, sample in samples.items():
            rows += [{"configuration": name, **row} for row in speed_rows(sample, "offline")]
        advance(1)
    return Race(found, best, tuple(rows))


def steps(model: Model, batches: Sequence[int] = BATCHES) -> int:
    """How many steps ``run_race`` tells of at most, for a progress bar."""
    return len(model.configurations) + 2 + len(batches)


def metric_rows(race: Race) -> list[dict[str, Any]]:
    """What was measured as rows {metric, group, value, unit}; group: configuration and scenario."""
    rows: list[dict[str, Any]] = []

    def add(metric: str, group: str, value: float | None, unit: str) -> None:
        rows.append({"metric": metric, "group": group, "value": value, "unit": unit})

    for row in race.rows:
        threads = f"{row['threads']} thread{'s' if row['threads'] > 1 else ''}"
        group = f"{row['configuration']}, {row['scenario']}, batch {row['batch']}, {threads}"
        for name in ("p50_ms", "p90_ms", "p99_ms", "mean_ms"):
            add(name, f"{group}, {row['phase']}", row[name], "ms")
        if row["phase"] == "total":
            add("per_s", group, row["per_s"], "frames/s")
    for one in race.found.usable:
        add("difference_mm", one.name, one.difference.median_mm, "mm")
        add("error_change", one.name, one.difference.error_change, "share")
    best, plain = race.total(race.best.name, 1), race.total(race.found.usable[0].name, 1)
    add("speedup", race.best.name, float(np.divide(plain["p50_ms"], best["p50_ms"])), "1")
    return rows
