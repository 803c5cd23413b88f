"""The ways in which a model can compute its answers: how far off they are, and how fast."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.errors import UserError
from tactibench.frames.source import spread
from tactibench.plugins.base import Model, Stage
from tactibench.run.difference import Difference, answers_of, compare, declared_stages
from tactibench.run.latency import (
    BATCHES,
    LatencySample,
    offline_block,
    time_in_rounds,
)
from tactibench.run.machine import all_threads
from tactibench.run.predict import blinded
from tactibench.run.threads import limited_threads

COMPILED = "compiled"
"""Takes tens of seconds to make, so it is left out unless asked for."""
BRIEF_FRAMES, BRIEF_CALLS, BRIEF_ROUNDS = 50, 50, 5
"""Size of the race that chooses what a run times at length."""
ROUNDS, OFFLINE_ROUNDS = 10, 9
WAIT_S = 15.0
"""Seconds that the warm-ups of one scenario may take together, and its rounds as many again."""

Advance = Callable[[int], None]
Row = dict[str, Any]


@dataclass(frozen=True)
class Configuration:
    """One way to compute that works on this machine, and what it costs in accuracy."""

    name: str
    description: str
    stages: Sequence[Stage]
    difference: Difference


@dataclass(frozen=True)
class Configurations:
    """The ways that work, and for each other one the sentence why it does not."""

    usable: tuple[Configuration, ...]
    skipped: Mapping[str, str]

    def stages(self) -> dict[str, Sequence[Stage]]:
        """Return name -> stages of the ways that work."""
        return {way.name: way.stages for way in self.usable}


@dataclass(frozen=True)
class Race:
    """All ways of a model, timed against each other.

    Attributes:
        configurations: that were timed.
        best: the fastest of those whose answers may stand for float32.
        rows: those of a record, each with its configuration's name.
    """

    configurations: Configurations
    best: Configuration
    rows: tuple[Row, ...]

    def total(self, name: str, threads: int, batch: int = 1, scenario: str = "single") -> Any:
        """Return the row of the whole call of one configuration; None when it was not timed."""
        sought = (name, scenario, threads, batch, "total")
        columns = ("configuration", "scenario", "threads", "batch", "phase")
        matching = (row for row in self.rows if tuple(row[k] for k in columns) == sought)
        return next(matching, None)


def compare_configurations(
    model: Model,
    frames: Sequence[Frame],
    scored: Sequence[Answer | None],
    truth: Sequence[Answer],
    *,
    compiled: bool = False,
    advance: Advance = lambda _: None,
) -> Configurations:
    """Make every way ready and compare its answers with the float32 ones of the frames.

    A model that has no choice is taken as it is.

    Args:
        model: trained.
        frames: as a model may see them.
        scored: its answers in float32.
        truth: of the frames.
        compiled: whether to try torch.compile, too.
        advance: is told of every way.

    Raises:
        UserError: when no way works.
    """
    if not model.configurations:
        stages = declared_stages(model)
        difference = compare(answers_of(stages, frames), scored, truth)
        return Configurations((Configuration("default", model.timed_as, stages, difference),), {})
    usable, skipped = [], {}
    for name, description in model.configurations.items():
        if name == COMPILED and not compiled:
            skipped[name] = "it takes long to make; add --compile"
            continue
        try:
            stages = list(model.configured(name, frames[:1]))
        except UserError as reason:
            skipped[name] = str(reason)
        else:
            difference = compare(answers_of(stages, frames), scored, truth)
            usable.append(Configuration(name, description, stages, difference))
        advance(1)
    if not usable:
        reasons = "; ".join(f"{name}: {reason.rstrip('.')}" for name, reason in skipped.items())
        raise UserError(f"the model cannot be timed, none of its ways to compute works: {reasons}.")
    return Configurations(tuple(usable), skipped)


def fastest(ways: Iterable[Configuration], samples: Mapping[str, LatencySample]) -> Configuration:
    """Return the way with the lowest median of a whole call of those that may stand for float32.

    The median, because a neighbour's work shows in the upper quantiles first. Where none is
    allowed, the first is taken: float32 as it is.
    """
    every = list(ways)
    allowed = [way for way in every if way.difference.allowed] or every[:1]
    return min(allowed, key=lambda way: float(np.median(samples[way.name].total_ms)))


def race_briefly(
    model: Model,
    frames: Sequence[Frame],
    scored: Sequence[Answer | None],
    truth: Sequence[Answer],
    budget_s: float,
) -> tuple[Configuration, list[Row]]:
    """Return the fastest way on one thread, which a run times, and how all ways did."""
    rows = spread(range(len(frames)), BRIEF_FRAMES)
    few = [frames[row] for row in rows]
    with limited_threads(1):
        ways = compare_configurations(
            model, few, [scored[row] for row in rows], [truth[row] for row in rows]
        )
        samples = time_in_rounds(
            ways.stages(), few, threads=1, calls=BRIEF_CALLS, rounds=BRIEF_ROUNDS, budget_s=budget_s
        )
    raced = [
        {
            "configuration": way.description,
            "p50_ms": float(np.median(samples[way.name].total_ms)),
            **way.difference.as_row(),
        }
        for way in ways.usable
    ]
    return fastest(ways.usable, samples), raced


def race(
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

    Args:
        model: trained.
        frames: of a test.
        truth: of every frame.
        calls: at batch 1.
        batches: of ``offline``; None: 1, 8, 32 and 128.
        compiled: whether to try torch.compile, too.
        advance: is told of every finished step.
    """
    seen = [blinded(frame) for frame in frames]
    with limited_threads(1):
        scored = [model.predict([frame])[0] for frame in seen]
        ways = compare_configurations(
            model, seen, scored, truth, compiled=compiled, advance=advance
        )
    rows: list[Row] = []
    best = ways.usable[0]

    def time_all(scenario: str, threads: int, **settings: Any) -> dict[str, LatencySample]:
        with limited_threads(threads):
            samples = time_in_rounds(ways.stages(), seen, threads=threads, **settings)
        for name, sample in samples.items():
            rows.extend({"configuration": name, **row} for row in sample.rows(scenario))
        advance(1)
        return samples

    for threads in sorted({1, all_threads()}):
        samples = time_all(
            "single", threads, calls=max(calls, ROUNDS), rounds=ROUNDS, budget_s=WAIT_S
        )
        if threads == 1:
            best = fastest(ways.usable, samples)
    for batch in BATCHES if batches is None else batches:
        time_all(
            "offline",
            all_threads(),
            batch=batch,
            calls=OFFLINE_ROUNDS,
            rounds=OFFLINE_ROUNDS,
            budget_s=WAIT_S / 3,
            block=offline_block(batch),
        )
    return Race(ways, best, tuple(rows))


def race_steps(model: Model, batches: Sequence[int] = BATCHES) -> int:
    """Return of how many steps ``race`` tells at most, for a progress bar."""
    return len(model.configurations) + 2 + len(batches)


def metric_rows(finished: Race) -> list[Row]:
    """Return what was measured as rows {metric, group, value, unit}, by configuration."""
    rows: list[Row] = []

    def add(metric: str, group: str, value: float | None, unit: str) -> None:
        rows.append({"metric": metric, "group": group, "value": value, "unit": unit})

    for row in finished.rows:
        threads = f"{row['threads']} thread{'s' if row['threads'] > 1 else ''}"
        group = f"{row['configuration']}, {row['scenario']}, batch {row['batch']}, {threads}"
        for name in ("p50_ms", "p90_ms", "p99_ms", "mean_ms"):
            add(name, f"{group}, {row['phase']}", row[name], "ms")
        if row["phase"] == "total":
            add("per_s", group, row["per_s"], "frames/s")
    usable = finished.configurations.usable
    for way in usable:
        add("difference_mm", way.name, way.difference.median_mm, "mm")
        add("error_change", way.name, way.difference.error_change, "share")
    best, plain = finished.total(finished.best.name, 1), finished.total(usable[0].name, 1)
    add("speedup", finished.best.name, float(np.divide(plain["p50_ms"], best["p50_ms"])), "1")
    return rows
