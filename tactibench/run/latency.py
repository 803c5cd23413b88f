"""Latency scenarios: how long one call takes, phase by phase.

``single``: one frame a call, as in a closed loop. ``offline``: a batch a call. Both warm up until
two successive blocks of calls have medians that differ by less than 2 %, then keep every raw time.
Scoring is never inside a call. The number of threads is set by the caller and only noted here.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle, islice, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

Stage = tuple[str, Callable[[Any], Any]]
Clock = Callable[[], float]

SETTLED_WITHIN = 0.02


@dataclass(frozen=True, eq=False)
class LatencySample:
    """Raw times. phases: their names, in order. raw_ms: (calls, phases) milliseconds.

    settled: whether the warm-up ended by itself, after warmup_calls calls. threads: as the caller
    set them. batch: frames in a call.
    """

    phases: tuple[str, ...]
    raw_ms: npt.NDArray[np.float64]
    settled: bool
    warmup_calls: int
    threads: int
    batch: int = 1

    def __post_init__(self) -> None:
        raw = np.array(self.raw_ms, dtype=np.float64)
        if raw.ndim != 2 or raw.shape[1] != len(self.phases) or not len(raw):
            raise ValueError(f"raw times have shape {raw.shape} for {len(self.phases)} phases")
        raw.setflags(write=False)
        object.__setattr__(self, "raw_ms", raw)

    @property
    def total_ms(self) -> npt.NDArray[np.float64]:
        """(calls,) time of a whole call, ms."""
        return np.asarray(self.raw_ms.sum(axis=1), dtype=np.float64)


def time_single(
    stages: Sequence[Stage],
    frames: Sequence[Any],
    *,
    threads: int,
    calls: int = 300,
    budget_s: float | None = None,
    clock: Clock = time.perf_counter,
) -> LatencySample:
    """Time the stages, each given what the one before returned, on one-frame lists.

    Frames are taken in turn, again from the first when they are used up. calls: that are timed.
    budget_s: seconds after which the warm-up counts as not settled and the timing stops, though
    never before one block of 20 timed calls.
    """
    inputs = [[frame] for frame in frames]
    return _measure(stages, inputs, 1, threads, calls, budget_s, clock, block=20, cap=500)


def time_offline(
    stages: Sequence[Stage],
    frames: Sequence[Any],
    batch: int,
    *,
    threads: int,
    calls: int = 30,
    budget_s: float | None = None,
    clock: Clock = time.perf_counter,
    block: int = 5,
) -> LatencySample:
    """Time the stages on lists of ``batch`` frames, taken in turn; otherwise as ``time_single``.

    A call is longer here, so blocks are ``block`` calls and the warm-up ends after ten of them at
    the latest.
    """
    inputs = batches(frames, batch)
    return _measure(
        stages, inputs, batch, threads, calls, budget_s, clock, block=block, cap=10 * block
    )


def time_in_rounds(
    models: Mapping[str, Sequence[Stage]],
    frames: Sequence[Any],
    batch: int = 1,
    *,
    threads: int,
    calls: int = 300,
    rounds: int = 10,
    budget_s: float | None = None,
    clock: Clock = time.perf_counter,
    block: int = 20,
) -> dict[str, LatencySample]:
    """Time several lists of stages on the same frames in turns, so that all meet the same noise.

    Each warms up first, as in the scenarios; then ``rounds`` times each is called ``calls /
    rounds`` times. budget_s: seconds for all warm-ups together, and as many for all rounds, of
    which the first is always finished.
    """
    if rounds < 1 or calls < rounds:
        raise ValueError(f"{calls} calls in {rounds} rounds: at least one call a round is needed")
    sources = {name: cycle(batches(frames, batch)) for name in models}
    share = None if budget_s is None else budget_s / max(1, len(models))
    warm: dict[str, tuple[bool, int]] = {}
    raw: dict[str, list[list[float]]] = {name: [] for name in models}
    with _no_collection():
        for name, stages in models.items():
            _check(stages, frames, calls)
            over = _deadline(share, clock)
            warm[name] = _warm_up(stages, sources[name], clock, over, block, 25 * block)
        over = _deadline(budget_s, clock)
        for number in range(rounds):
            if number and over():
                break
            for name, stages in models.items():
                for _ in range(calls // rounds):
                    raw[name].append(_call(stages, next(sources[name]), clock))
    return {
        name: LatencySample(
            tuple(phase for phase, _ in stages),
            1e3 * np.array(raw[name]),
            *warm[name],
            threads,
            batch,
        )
        for name, stages in models.items()
    }


def batches(frames: Sequence[Any], batch: int) -> list[list[Any]]:
    """Lists of ``batch`` frames, all frames taken in turn, the first ones again at the end."""
    if batch < 1:
        raise ValueError(f"batch is {batch}, it must be at least 1")
    endless = cycle(frames)
    return [list(islice(endless, batch)) for _ in range(-(-len(frames) // batch))]


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Let torch compute with ``count`` threads inside the block, and as before after it."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def _no_collection() -> Iterator[None]:
    """Keep the garbage collector out of timed calls."""
    was_on = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _measure(
    stages: Sequence[Stage],
    inputs: Sequence[list[Any]],
    batch: int,
    threads: int,
    calls: int,
    budget_s: float | None,
    clock: Clock,
    *,
    block: int,
    cap: int,
) -> LatencySample:
    phases = _check(stages, inputs, calls)
    source = cycle(inputs)
    over = _deadline(budget_s, clock)
    with _no_collection():
        settled, warmup = _warm_up(stages, source, clock, over, block, cap)
        raw: list[list[float]] = []
        while len(raw) < calls and not (len(raw) >= block and over()):
            raw.append(_call(stages, next(source), clock))
    return LatencySample(phases, 1e3 * np.array(raw), settled, warmup, threads, batch)


def _check(stages: Sequence[Stage], inputs: Sequence[Any], calls: int) -> tuple[str, ...]:
    """The phases' names. Raises ValueError for a job that cannot be timed."""
    phases = tuple(name for name, _ in stages)
    if not stages or not inputs or calls < 1:
        raise ValueError("timing needs at least one stage, one frame and one call")
    if len(set(phases)) < len(phases) or "total" in phases:
        raise ValueError(f"phases must have different names, none of them 'total': {phases}")
    return phases


def _deadline(budget_s: float | None, clock: Clock) -> Callable[[], bool]:
    """Tells whether that many seconds have passed since now."""
    start = clock()
    return lambda: budget_s is not None and clock() - start >= budget_s


def _warm_up(
    stages: Sequence[Stage],
    source: Iterator[list[Any]],
    clock: Clock,
    over: Callable[[], bool],
    block: int,
    cap: int,
) -> tuple[bool, int]:
    """Call until two successive blocks agree. Returns whether they did, and the calls made."""
    before = float("inf")
    done = 0
    while done + block <= cap and not over():
        times = [sum(_call(stages, next(source), clock)) for _ in range(block)]
        done += block
        median = float(np.median(times))
        if abs(median - before) < SETTLED_WITHIN * before < float("inf"):
            return True, done
        before = median
    return False, done


def _call(stages: Sequence[Stage], value: Any, clock: Clock) -> list[float]:
    """Seconds of every stage in one call."""
    marks = [clock()]
    for _, stage in stages:
        value = stage(value)
        marks.append(clock())
    return [after - before for before, after in pairwise(marks)]
