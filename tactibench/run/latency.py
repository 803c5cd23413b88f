"""Latency: how long one call takes, phase by phase.

A call is given one frame, as in a closed loop, or a batch of frames. It warms up until two
successive blocks of calls have medians that differ by less than 2 %, then keeps every raw time.
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

from tactibench.errors import UserError
from tactibench.plugins.base import Stage

Clock = Callable[[], float]

SETTLED_WITHIN = 0.02
"""Relative difference of the medians of two blocks of calls at which a warm-up ends."""
BLOCK = 20
"""Calls of a block: enough for a median that a neighbour's work does not move."""
WARMUP_BLOCKS = 25
"""Blocks after which a warm-up ends although it has not settled."""


BATCHES = (1, 8, 32, 128)
"""Frames of a call in the scenario ``offline``."""


@dataclass(frozen=True, eq=False)
class LatencySample:
    """Raw times of one way to compute.

    Attributes:
        phases: their names, in order.
        raw_ms: (calls, phases) milliseconds.
        settled: whether the warm-up ended by itself.
        warmup_calls: calls of the warm-up.
        threads: as the caller set them.
        batch: frames in a call.
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
        """Return (calls,) the time of a whole call, ms."""
        return np.asarray(self.raw_ms.sum(axis=1), dtype=np.float64)

    def rows(self, scenario: str) -> list[dict[str, Any]]:
        """Return a row of a record for each phase and one for the phase "total", ms a call.

        per_s is the same in every row: frames per second of the whole call, from its mean.
        Quantiles interpolate linearly. p50 <= p90 <= p99 always; the quantiles of phases do not
        add up.
        """
        whole = self.total_ms
        per_s = 1e3 * self.batch / float(whole.mean()) if whole.any() else float("inf")
        columns = {name: self.raw_ms[:, k] for k, name in enumerate(self.phases)}
        rows = []
        for phase, times in {**columns, "total": whole}.items():
            p50, p90, p99 = (float(q) for q in np.quantile(times, (0.5, 0.9, 0.99)))
            rows.append(
                {
                    "scenario": scenario,
                    "threads": self.threads,
                    "batch": self.batch,
                    "phase": phase,
                    "p50_ms": p50,
                    "p90_ms": p90,
                    "p99_ms": p99,
                    "mean_ms": float(times.mean()),
                    "per_s": per_s,
                    "settled": self.settled,
                }
            )
        return rows


def time_calls(
    stages: Sequence[Stage],
    frames: Sequence[Any],
    batch: int = 1,
    *,
    threads: int,
    calls: int = 300,
    budget_s: float | None = None,
    clock: Clock = time.perf_counter,
    block: int = BLOCK,
    warmup_blocks: int = WARMUP_BLOCKS,
) -> LatencySample:
    """Time the stages, each given what the one before returned, on lists of frames.

    Args:
        stages: of the model.
        frames: are taken in turn, again from the first when they are used up.
        batch: frames of a call.
        threads: as the caller set them.
        calls: that are timed.
        budget_s: seconds after which the warm-up counts as not settled and the timing stops, though
            never before one block of timed calls.
        clock: gives seconds.
        block: calls of a block.
        warmup_blocks: of the warm-up, at most.

    Raises:
        ValueError: for a job that cannot be timed.
    """
    phases = _check(stages, frames, calls)
    source = cycle(batches(frames, batch))
    over = _deadline(budget_s, clock)
    with _no_collection():
        settled, warmup = _warm_up(stages, source, clock, over, block, warmup_blocks)
        raw: list[list[float]] = []
        while len(raw) < calls and not (len(raw) >= block and over()):
            raw.append(_call(stages, next(source), clock))
    return LatencySample(phases, 1e3 * np.array(raw), settled, warmup, threads, batch)


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
    block: int = BLOCK,
) -> dict[str, LatencySample]:
    """Time several lists of stages on the same frames in turns, so that all meet the same noise.

    Each warms up first, as in ``time_calls``; then ``rounds`` times each is called ``calls /
    rounds`` times.

    Args:
        models: name -> stages.
        frames: are taken in turn by each.
        batch: frames of a call.
        threads: as the caller set them.
        calls: of each.
        rounds: how many turns each has.
        budget_s: seconds for all warm-ups together, and as many for all rounds, of which the first
            is always finished.
        clock: gives seconds.
        block: calls of a block of the warm-up.

    Raises:
        ValueError: for a job that cannot be timed.
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
            warm[name] = _warm_up(stages, sources[name], clock, over, block, WARMUP_BLOCKS)
        over = _deadline(budget_s, clock)
        for number in range(rounds):
            if number and over():
                break
            for name, stages in models.items():
                for _ in range(calls // rounds):
                    raw[name].append(_call(stages, next(sources[name]), clock))
    samples = {}
    for name, stages in models.items():
        phases = tuple(phase for phase, _ in stages)
        times = 1e3 * np.array(raw[name])
        samples[name] = LatencySample(phases, times, *warm[name], threads, batch)
    return samples


def offline_block(batch: int) -> int:
    """Return how many calls make a block: few, because a call of a large batch is long."""
    return BLOCK // 4 if batch <= 8 else 1


def batches(frames: Sequence[Any], batch: int) -> list[list[Any]]:
    """Return lists of ``batch`` frames, all taken in turn, the first ones again at the end."""
    if batch < 1:
        raise ValueError(f"batch is {batch}, it must be at least 1")
    endless = cycle(frames)
    return [list(islice(endless, batch)) for _ in range(-(-len(frames) // batch))]


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Let torch compute with ``count`` threads inside the block, and as before after it.

    Raises:
        UserError: The block has changed the number.
    """
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
        found = torch.get_num_threads()
    finally:
        torch.set_num_threads(before)
    if found != count:
        raise UserError(
            f"the model set torch's threads to {found} while it was timed with {count}, so that "
            "the times are of no known number of threads; take torch.set_num_threads out of it."
        )


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


def _check(stages: Sequence[Stage], frames: Sequence[Any], calls: int) -> tuple[str, ...]:
    """The phases' names. Raises ValueError for a job that cannot be timed."""
    phases = tuple(name for name, _ in stages)
    if not stages or not frames or calls < 1:
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
    blocks: int,
) -> tuple[bool, int]:
    """Call until two successive blocks agree. Returns whether they did, and the calls made."""
    before = float("inf")
    done = 0
    while done < block * blocks and not over():
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
