"""Latency: how long one call takes, phase by phase.

A call is given one frame, as in a closed loop, or a batch of frames. Calls warm up until two
successive blocks have medians that differ by less than 2 %. Then every raw time is stored, with the
processor time of the process. Scoring is never inside a call. The caller sets the number of
threads; this module only records it.

Times are *settled* when the warm-up ended by itself and the machine was quiet: other processes and
other machines took at most 10 % of the processors, and the process computed for at least 90 % of
the time. On one thread processor and wall time agree within 10 %: a process with more processor
time computed on other threads. That they agree is not enough, because work on the processor beside
it takes cache, memory and clock rate from it, which makes both times longer.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle, islice, pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tactibench.plugins import Stage
from tactibench.run.load import QUIET, Counter, Load, counters, load_between

Clock = Callable[[], float]


class Clocks(NamedTuple):
    """The clocks of a timing.

    Attributes:
        wall: Returns wall time, s.
        processor: Returns processor time of the process, s.
        counters: Returns the counters of the machine's load.
    """

    wall: Clock = time.perf_counter
    processor: Clock = time.process_time
    counters: Counter = counters


CLOCKS = Clocks()
Times = list[list[float]]
"""Seconds of every stage of every call."""

SETTLED_WITHIN = 0.02
"""Relative difference of the medians of two blocks of calls at which a warm-up ends."""
BLOCK = 20
"""Calls of a block: enough for a median that other work on the machine does not move."""
READING_MS = 0.003
"""Longest time that reading the clocks of a phase takes, ms: processor and wall time of a call of a
few microseconds differ by it."""
WARMUP_BLOCKS = 25
"""Blocks after which a warm-up ends although it has not settled."""


BATCHES = (1, 8, 32, 128)
"""Frames of a call in the scenario ``offline``."""


@dataclass(frozen=True, eq=False)
class LatencySample:
    """Raw times of one way to compute.

    Attributes:
        phases: Names of the phases, in order.
        raw_ms: (calls, phases) wall time, ms.
        warm: Whether the warm-up ended by itself.
        warmup_calls: Number of calls of the warm-up.
        threads: Number of threads that the caller set.
        batch: Number of frames in a call.
        cpu_ms: (calls, phases) processor time of the whole process, ms.
        load: Load of the machine meanwhile.
    """

    phases: tuple[str, ...]
    raw_ms: npt.NDArray[np.float64]
    warm: bool
    warmup_calls: int
    threads: int
    batch: int
    cpu_ms: npt.NDArray[np.float64]
    load: Load

    @property
    def quiet(self) -> bool:
        """Return whether no other work disturbed the times, as far as this can be known."""
        wall = float(self.raw_ms.sum())
        slack = QUIET * wall + READING_MS * self.raw_ms.size
        more = float(self.cpu_ms.sum()) - wall
        if more < -slack or (self.threads == 1 and more > slack):
            return False
        return self.load.quiet is not False

    @property
    def settled(self) -> bool:
        """Return whether the times neither drifted nor were disturbed."""
        return self.warm and self.quiet

    @property
    def total_ms(self) -> npt.NDArray[np.float64]:
        """Return the time of every whole call, (calls,) ms."""
        return np.asarray(self.raw_ms.sum(axis=1), dtype=np.float64)

    def rows(self, scenario: str) -> list[dict[str, Any]]:
        """Return a row of a record for each phase and one for the phase "total", ms per call.

        per_s is the same in every row: frames per second of whole calls, from their mean time.
        Quantiles interpolate linearly. p50 <= p90 <= p99 always, but the quantiles of phases do not
        add up.

        Args:
            scenario: "single" or "offline".
        """
        total = self.total_ms
        per_s = 1e3 * self.batch / float(total.mean()) if total.any() else float("inf")
        columns = {name: self.raw_ms[:, k] for k, name in enumerate(self.phases)}
        means = self.cpu_ms.mean(axis=0)
        cpu = dict(zip(self.phases, map(float, means), strict=True)) | {"total": float(means.sum())}
        rows = []
        for phase, times in {**columns, "total": total}.items():
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
                    "cpu_ms": cpu[phase],
                    "stolen": self.load.stolen,
                    "foreign": self.load.foreign,
                    "load": self.load.average,
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
    clocks: Clocks = CLOCKS,
    block: int = BLOCK,
    warmup_blocks: int = WARMUP_BLOCKS,
) -> LatencySample:
    """Time stages on lists of frames; each stage is given what the stage before returned.

    Args:
        stages: Stages of the model.
        frames: Frames that are taken in turn, again from the first when they are used up.
        batch: Number of frames of a call.
        threads: Number of threads that the caller set.
        calls: Number of calls that are timed.
        budget_s: Seconds after which the warm-up counts as not settled and the timing stops, but
            never before one block of timed calls; None for no limit.
        clocks: Clocks that are read.
        block: Number of calls of a block.
        warmup_blocks: Most blocks of the warm-up.

    Raises:
        ValueError: There is no stage, frame or call, two phases have one name, a phase is called
            "total", or the batch is empty.
    """
    phases = _check(stages, frames, calls)
    source = cycle(batches(frames, batch))
    over = _deadline(budget_s, clocks.wall)
    with _no_collection():
        warm, warmup = _warm_up(stages, source, clocks, over, block, warmup_blocks)
        raw: Times = []
        cpu: Times = []
        before = clocks.counters()
        while len(raw) < calls and not (len(raw) >= block and over()):
            _call(stages, next(source), clocks, raw, cpu)
        load = load_between(before, clocks.counters())
    times, computed = 1e3 * np.array(raw), 1e3 * np.array(cpu)
    return LatencySample(phases, times, warm, warmup, threads, batch, computed, load)


def time_in_rounds(
    models: Mapping[str, Sequence[Stage]],
    frames: Sequence[Any] | Mapping[str, Sequence[Any]],
    batch: int = 1,
    *,
    threads: int,
    calls: int = 300,
    rounds: int = 10,
    budget_s: float | None = None,
    clocks: Clocks = CLOCKS,
    block: int = BLOCK,
    advance: Callable[[int], None] = lambda _: None,
) -> dict[str, LatencySample]:
    """Time several lists of stages in turns, so that all meet the same noise.

    Each list warms up first, as in ``time_calls``. Then there are ``rounds`` rounds, in which each
    list is called ``calls / rounds`` times.

    Args:
        models: Name -> stages.
        frames: Frames that each list takes in turn; a mapping has the frames of every name.
        batch: Number of frames of a call.
        threads: Number of threads that the caller set.
        calls: Number of calls of each list.
        rounds: Number of rounds.
        budget_s: Seconds for all warm-ups together, and as many for all rounds, of which the first
            is always finished; None for no limit.
        clocks: Clocks that are read.
        block: Number of calls of a block of the warm-up.
        advance: Function that is called after every round.

    Raises:
        ValueError: There are no rounds or fewer calls than rounds, a list has no stage or frame,
            two phases have one name, a phase is called "total", or the batch is empty.
    """
    if rounds < 1 or calls < rounds:
        raise ValueError(f"{calls} calls in {rounds} rounds: at least one call a round is needed")
    frames_of = frames if isinstance(frames, Mapping) else dict.fromkeys(models, frames)
    sources = {name: cycle(batches(frames_of[name], batch)) for name in models}
    share = None if budget_s is None else budget_s / max(1, len(models))
    warm: dict[str, tuple[bool, int]] = {}
    raw: dict[str, Times] = {name: [] for name in models}
    cpu: dict[str, Times] = {name: [] for name in models}
    with _no_collection():
        for name, stages in models.items():
            _check(stages, frames_of[name], calls)
            over = _deadline(share, clocks.wall)
            warm[name] = _warm_up(stages, sources[name], clocks, over, block, WARMUP_BLOCKS)
        over = _deadline(budget_s, clocks.wall)
        # Over all rounds: the calls of one model in a round are too short for ticks of 10 ms.
        before = clocks.counters()
        for number in range(rounds):
            if number and over():
                break
            for name, stages in models.items():
                for _ in range(calls // rounds):
                    _call(stages, next(sources[name]), clocks, raw[name], cpu[name])
            advance(1)
        load = load_between(before, clocks.counters())
    return {
        name: LatencySample(
            tuple(phase for phase, _ in stages),
            1e3 * np.array(raw[name]),
            *warm[name],
            threads,
            batch,
            1e3 * np.array(cpu[name]),
            load,
        )
        for name, stages in models.items()
    }


def offline_block(batch: int) -> int:
    """Return the number of calls of a block: few, because a call of a large batch is long."""
    return BLOCK // 4 if batch <= 8 else 1


def batches(frames: Sequence[Any], batch: int) -> list[list[Any]]:
    """Return lists of ``batch`` frames, all taken in turn, the first ones again at the end.

    Raises:
        ValueError: ``batch`` is less than 1.
    """
    if batch < 1:
        raise ValueError(f"batch is {batch}, it must be at least 1")
    endless = cycle(frames)
    return [list(islice(endless, batch)) for _ in range(-(-len(frames) // batch))]


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
    """Return the names of the phases.

    Raises:
        ValueError: There is no stage, frame or call, two phases have one name, or a phase is called
            "total".
    """
    phases = tuple(name for name, _ in stages)
    if not stages or not frames or calls < 1:
        raise ValueError("timing needs at least one stage, one frame and one call")
    if len(set(phases)) < len(phases) or "total" in phases:
        raise ValueError(f"phases must have different names, none of them 'total': {phases}")
    return phases


def _deadline(budget_s: float | None, clock: Clock) -> Callable[[], bool]:
    """Return a function that tells whether ``budget_s`` seconds have passed since now."""
    start = clock()
    return lambda: budget_s is not None and clock() - start >= budget_s


def _warm_up(
    stages: Sequence[Stage],
    source: Iterator[list[Any]],
    clocks: Clocks,
    over: Callable[[], bool],
    block: int,
    blocks: int,
) -> tuple[bool, int]:
    """Call the stages until two successive blocks agree.

    Returns:
        Whether two blocks agreed, and the number of calls.
    """
    before = float("inf")
    done = 0
    while done < block * blocks and not over():
        raw: Times = []
        for _ in range(block):
            _call(stages, next(source), clocks, raw, [])
        done += block
        median = float(np.median([sum(times) for times in raw]))
        if abs(median - before) < SETTLED_WITHIN * before < float("inf"):
            return True, done
        before = median
    return False, done


def _call(stages: Sequence[Stage], value: Any, clocks: Clocks, raw: Times, cpu: Times) -> None:
    """Call the stages once; append the wall and processor seconds of every stage."""
    wall, processor, _ = clocks
    computed, marks = [processor()], [wall()]
    for _, stage in stages:
        value = stage(value)
        marks.append(wall())
        computed.append(processor())
    raw.append([after - before for before, after in pairwise(marks)])
    cpu.append([after - before for before, after in pairwise(computed)])
