"""The ways in which a model can compute its answers: how much the answers differ, and how fast."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.errors import UserError
from tactibench.frames import spread
from tactibench.plugins import Model, Stage
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
"""The configuration that is prepared for tens of seconds, so it is left out unless requested."""
BRIEF_FRAMES, BRIEF_CALLS, BRIEF_ROUNDS = 50, 50, 5
"""Size of the race that chooses the configuration which a run times at length."""
ROUNDS, OFFLINE_ROUNDS = 10, 9
"""Rounds of a scenario with single frames, and of one with batches."""
WAIT_S = 15.0
"""Seconds that the warm-ups of a scenario with single frames may take together; its rounds may take
as many again."""

Advance = Callable[[int], None]
Row = dict[str, Any]


@dataclass(frozen=True)
class Configuration:
    """A way to compute that works on this machine, and what it costs in accuracy.

    Attributes:
        name: Name of the way.
        description: Description of the way, as the model gives it.
        stages: Functions from frames to answers, by name.
        difference: Difference of its answers from those in float32.
    """

    name: str
    description: str
    stages: Sequence[Stage]
    difference: Difference


@dataclass(frozen=True)
class Configurations:
    """The ways of a model to compute.

    Attributes:
        usable: The ways that work.
        skipped: Name of every other way -> the sentence why it was left out.
    """

    usable: tuple[Configuration, ...]
    skipped: Mapping[str, str]

    def stages(self) -> dict[str, Sequence[Stage]]:
        """Return name -> stages of the ways that work."""
        return {way.name: way.stages for way in self.usable}


@dataclass(frozen=True)
class Race:
    """All ways of a model to compute, timed against each other.

    Attributes:
        configurations: The ways, of which the usable ones were timed.
        best: The fastest way whose answers may stand for float32.
        rows: Rows of a record, each with the name of its configuration.
    """

    configurations: Configurations
    best: Configuration
    rows: tuple[Row, ...]

    def total(self, name: str, threads: int, batch: int = 1, scenario: str = "single") -> Any:
        """Return the row of whole calls of a configuration; None when it was not timed.

        Args:
            name: Name of the configuration.
            threads: Number of threads.
            batch: Number of frames of a call.
            scenario: "single" or "offline".
        """
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
    """Prepare every way and compare its answers with those in float32.

    A model without a choice is taken as it is.

    Args:
        model: A trained model.
        frames: Frames as a model may see them.
        scored: The model's answers to the frames in float32.
        truth: True answers to the frames.
        compiled: Whether to try torch.compile, too.
        advance: Function that is called after every way.

    Raises:
        UserError: No way works.
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
    """Return the fastest way among those whose answers may stand for float32.

    That is the way with the lowest median of a whole call: other work on the machine shows in the
    upper quantiles first. Where no way is allowed, the first one is taken, which is float32.

    Args:
        ways: Ways that were timed, float32 first.
        samples: Name of a way -> its times.
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
    """Return the fastest way on one thread, which a run times, and a row for every way.

    Args:
        model: A trained model.
        frames: Frames as a model may see them.
        scored: The model's answers to the frames in float32.
        truth: True answers to the frames.
        budget_s: Seconds for all warm-ups together, and as many for all rounds.

    Returns:
        The fastest way, and rows with the description, median time and difference of every way.
    """
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
    """Time every configuration that works on this machine, ``single`` and ``offline``.

    ``single`` is timed with one thread and with all threads. The answers at batch 1 are compared
    with those of ``predict``, in float32, and with the truth. The best configuration is the one
    with the lowest median for one frame on one thread, among those whose answers may stand for
    float32.

    Args:
        model: A trained model.
        frames: Frames of a test.
        truth: True answer to every frame.
        calls: Number of calls at batch 1.
        batches: Sizes of the batches of ``offline``; None: 1, 8, 32 and 128.
        compiled: Whether to try torch.compile, too.
        advance: Function that is called after every step, at most ``race_steps`` times.

    Raises:
        UserError: No configuration works.
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
    """Return the largest number of steps of ``race``, for a progress bar."""
    return len(model.configurations) + 2 + len(batches)


def metric_rows(finished: Race) -> list[Row]:
    """Return the results of a race as rows {metric, group, value, unit}, by configuration."""
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
