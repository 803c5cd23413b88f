"""Speed of a trained model in the scenarios ``single`` and ``offline``, and its cost."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.errors import UserError
from tactibench.frames import spread
from tactibench.plugins import Model, Stage, describe_method
from tactibench.run.difference import answers_of, compare, declared_stages
from tactibench.run.latency import BATCHES, LatencySample, offline_block, time_calls
from tactibench.run.machine import all_threads
from tactibench.run.predict import blinded
from tactibench.run.threads import limited_threads

TIMED_FRAMES = 200
"""Test frames that calls take in turn, spread over all: groups follow each other in a test."""
CALLS, QUICK_CALLS = 300, 60
"""Timed calls with one frame, and those of --quick."""
BUDGET_S, QUICK_BUDGET_S = 12.0, 3.0
"""Seconds that timing may take for one number of threads; a slower model gives fewer calls. --quick
has few, so that other work on the machine does not use up its minute."""
OFFLINE_CALLS, OFFLINE_BLOCKS = 30, 10
"""Calls and warm-up blocks with a batch: fewer than with one frame, because each takes longer."""

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_RESET_PEAK = "5"
"""Written to clear_refs, it sets the peak of the resident memory to its present size (proc(5))."""


@dataclass(frozen=True)
class Speed:
    """Times and cost of a model; empty where it was not timed.

    Attributes:
        rows: Rows of the record.
        raw: Raw times, ms, by name.
        timed: The timed configuration and what it costs in accuracy.
        efficiency: Size, operations and memory of the model.
    """

    rows: list[dict[str, Any]] = field(default_factory=list)
    raw: dict[str, np.ndarray] = field(default_factory=dict)
    timed: dict[str, Any] = field(default_factory=dict)
    efficiency: dict[str, Any] = field(default_factory=dict)

    def add(self, scenario: str, sample: LatencySample) -> None:
        """Add the rows and the raw times of a scenario, "single" or "offline"."""
        self.rows.extend(sample.rows(scenario))
        single = scenario == "single"
        name = f"single_{sample.threads}_threads" if single else f"offline_{sample.batch}_frames"
        self.raw[f"{name}_ms"] = np.asarray(sample.raw_ms)
        self.raw[f"{name}_cpu_ms"] = np.asarray(sample.cpu_ms)


def time_model(
    model: Model,
    frames: Sequence[Frame],
    answers: Sequence[Answer | None],
    *,
    truth: Sequence[Answer],
    quick: bool = False,
) -> Speed:
    """Time frame -> answer: at batch 1 with one thread and with all, and in batches with all.

    The ways to compute that the model offers are first timed against each other. The fastest way
    whose error is within 2 % of that in float32 is then timed.

    Args:
        model: A trained model.
        frames: Test frames.
        answers: The scored answers, in float32.
        truth: True answer to every frame.
        quick: Whether to time few calls of the stages that the model declares, without a choice.

    Raises:
        UserError: The model declares wrong stages, counts or answers, or none of its ways to
            compute works.
    """
    rows = spread(range(len(frames)), TIMED_FRAMES)
    seen = [blinded(frames[row]) for row in rows]
    scored, true = [answers[row] for row in rows], [truth[row] for row in rows]
    calls, budget_s = (QUICK_CALLS, QUICK_BUDGET_S) if quick else (CALLS, BUDGET_S)
    configuration: str = model.timed_as
    stages: Sequence[Stage] = declared_stages(model)
    raced: list[dict[str, Any]] = []
    if model.configurations and not quick:
        from tactibench.run.configurations import race_briefly

        best, raced = race_briefly(model, seen, scored, true, budget_s)
        configuration, stages = best.description, best.stages
    with suppress(OSError):  # another system, or a kernel without it
        _RESET.write_text(_RESET_PEAK)
    speed, threads = Speed(), all_threads()
    for count in sorted({1, threads}):
        with limited_threads(count):
            sample = time_calls(stages, seen, threads=count, calls=calls, budget_s=budget_s)
        speed.add("single", sample)
    peak_mb = _peak_mb()
    with limited_threads(threads):
        for batch in BATCHES:
            sample = time_calls(
                stages,
                seen,
                batch,
                threads=threads,
                calls=OFFLINE_CALLS,
                budget_s=budget_s / 6,
                block=offline_block(batch),
                warmup_blocks=OFFLINE_BLOCKS,
            )
            speed.add("offline", sample)
    difference = compare(answers_of(stages, seen), scored, None if quick else true)
    speed.timed.update(configuration=configuration, **difference.as_row(), raced=raced)
    speed.efficiency.update(
        parameters=_count(model, "parameter_count", model.parameter_count()),
        flops_per_frame=_count(model, "flops", model.flops(seen[0])),
        peak_memory_mb=peak_mb,
    )
    return speed


def _count(model: Model, method: str, count: object) -> int | None:
    """Return a number that a method of the model returns, or None.

    Raises:
        UserError: The value is neither a whole number from 0 on nor None.
    """
    if count is None:
        return None
    if not isinstance(count, (int, np.integer)) or isinstance(count, bool) or count < 0:
        raise UserError(
            f"the model gave {count!r:.60} where a whole number or None is asked; fix "
            f"{describe_method(model, method)}."
        )
    return int(count)


def _peak_mb() -> float | None:
    """Return the peak of the resident memory, MB (10^6 bytes); None where it is not known.

    Where the kernel cannot reset its count, it is the peak of the whole life of the process.
    """
    try:
        lines = _STATUS.read_text(encoding="utf-8").splitlines()
    except OSError:
        return _peak_of_life_mb()
    kib = [int(line.split()[1]) for line in lines if line.startswith("VmHWM:")]
    return 1.024e-3 * kib[0] if kib else _peak_of_life_mb()


def _peak_of_life_mb() -> float | None:
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return 1e-6 * unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
