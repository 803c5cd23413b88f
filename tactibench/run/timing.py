"""Speed of a trained model: how long its answers take, phase by phase, and what it costs.

What is timed are the stages of the model, which are what ``predict`` computes and what is scored.
A call is given one frame, as in a closed loop (scenario ``single``), or a batch of frames
(``offline``). Calls warm up until two successive blocks have medians that differ by less than 2 %.
Then every raw time is stored, with the processor time of the process. Scoring is never inside a
call.

Times are *settled* when the warm-up ended by itself and the machine was quiet: other processes and
other machines took at most 10 % of the processors, and the process computed for at least 90 % of
the time. On one thread processor and wall time agree within 10 %: a process with more processor
time computed on other threads. That they agree is not enough, because work on the processor beside
it takes cache, memory and clock rate from it, which makes both times longer.

Linux counts in ``/proc/stat`` what each processor did, in ticks of usually 10 ms; time that a
hypervisor gave to other machines is "steal". Work that is not of this process is *foreign*. Other
systems have no such counters: every share is then None, not known.
"""

from __future__ import annotations

import gc
import os
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import cycle, islice, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame
from tactibench.errors import UserError
from tactibench.frames import spread
from tactibench.plugins import Model, Stage, describe_method
from tactibench.records import SpeedRow
from tactibench.run.machine import all_threads, limited_threads
from tactibench.run.predict import blinded
from tactibench.run.worker import WorkerModel

BATCHES = (1, 8, 32, 128)
"""Frames of a call in the scenario ``offline``."""
TIMED_FRAMES = 200
"""Test frames that calls take in turn, spread over all: groups follow each other in a test."""
CALLS, QUICK_CALLS, OFFLINE_CALLS = 300, 60, 30
"""Timed calls with one frame, those of --quick, and calls with a batch, each of which is longer."""
BUDGET_S, QUICK_BUDGET_S = 12.0, 3.0
"""Seconds that timing one model may take for one number of threads; a slower model gives fewer
calls. --quick has few, so that other work on the machine does not use up its minute. The calls of
one size of batch may take a sixth of it."""
SETTLED_WITHIN = 0.02
"""Relative difference of the medians of two blocks of calls at which a warm-up ends."""
BLOCK = 20
"""Calls of a block: enough for a median that other work on the machine does not move."""
WARMUP_BLOCKS = 25
"""Blocks after which a warm-up ends although it has not settled."""
READING_MS = 0.003
"""Longest time that reading the clocks of a phase takes, ms: processor and wall time of a call of a
few microseconds differ by it."""
QUIET = 0.1
"""Largest share of processor time that may be stolen or foreign, and largest share by which
processor and wall time of one thread may differ: beyond it a median moves by more than the seeds of
one model differ."""
WINDOW_S = 0.2
"""Seconds below which no share is known: a tick of each processor would count 5 % or more."""

_STAT, _STATUS = Path("/proc/stat"), Path("/proc/self/status")
_RESET = Path("/proc/self/clear_refs")
_RESET_PEAK = "5"
"""Written to clear_refs, it sets the peak of the resident memory to its present size (proc(5))."""


@dataclass(frozen=True)
class Counters:
    """Seconds since the start of the machine, summed over the processors that this process may use.

    Attributes:
        busy_s: Time in which any process computed, s.
        stolen_s: Time in which a hypervisor computed for other machines, s.
        total_s: All time, idle time included, s.
        processors: Number of processors.
        own_s: Time in which this process computed, s.
    """

    busy_s: float
    stolen_s: float
    total_s: float
    processors: int
    own_s: float


@dataclass(frozen=True)
class Load:
    """The load while something was timed.

    Attributes:
        stolen: Share of the processors' time that a hypervisor took; None where it is not known.
        foreign: Share in which other processes computed, children of this process among them; None
            where it is not known.
        average: Load average of the last minute, at the end; None where it is not known.
    """

    stolen: float | None = None
    foreign: float | None = None
    average: float | None = None

    @classmethod
    def between(cls, before: Counters | None, after: Counters | None) -> Load:
        """Return the load between two moments; its shares are None where they cannot be known."""
        average = round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
        if before is None or after is None or before.processors != after.processors:
            return cls(average=average)
        total = after.total_s - before.total_s
        if total < WINDOW_S * after.processors:
            return cls(average=average)
        own_s = after.own_s - before.own_s
        foreign = max(0.0, after.busy_s - before.busy_s - own_s)
        stolen = max(0.0, after.stolen_s - before.stolen_s)
        return cls(min(stolen / total, 1.0), min(foreign / total, 1.0), average)

    @property
    def quiet(self) -> bool | None:
        """Return whether the stolen and foreign share is small; None where it is not known."""
        if self.stolen is None or self.foreign is None:
            return None
        return self.stolen + self.foreign <= QUIET


def settled_time(speed: SpeedRow) -> bool:
    """Return whether a time is settled: its record says so, and others took little meanwhile."""
    return speed.settled and Load(speed.stolen, speed.foreign).quiet is not False


def counters() -> Counters | None:
    """Return the present counters of this machine; None where the system has none."""
    own_s = time.process_time()
    try:
        text = _STAT.read_text(encoding="ascii", errors="replace")
        cpus = os.sched_getaffinity(0)
        tick_s = 1 / os.sysconf("SC_CLK_TCK")
    except (OSError, AttributeError, ValueError):
        return None
    return parse_stat(text, cpus, own_s, tick_s)


def parse_stat(text: str, cpus: Collection[int], own_s: float, tick_s: float) -> Counters | None:
    """Return the counters in the text of /proc/stat; None for a text without these processors.

    The columns are user, nice, system, idle, iowait, irq, softirq, steal; the guests that follow
    are counted in user and nice already (proc(5)).

    Args:
        text: Text of /proc/stat.
        cpus: Numbers of the processors that are counted.
        own_s: Processor time of this process, s.
        tick_s: Duration of a tick, s.
    """
    busy, stolen, total, count = 0, 0, 0, 0
    for line in text.splitlines():
        name, *fields = line.split()
        if not name.startswith("cpu") or not name[3:].isdigit() or int(name[3:]) not in cpus:
            continue
        user, nice, system, idle, waiting, irq, soft, steal = map(int, [*fields, *"00000000"][:8])
        computed = user + nice + system + irq + soft
        busy, stolen = busy + computed, stolen + steal
        total += computed + steal + idle + waiting
        count += 1
    if not count:
        return None
    return Counters(tick_s * busy, tick_s * stolen, tick_s * total, count, own_s)


class Clocks(NamedTuple):
    """The clocks of a timing.

    Attributes:
        wall: Returns wall time, s.
        processor: Returns processor time of the process, s.
        counters: Returns the counters of the machine's load.
    """

    wall: Callable[[], float] = time.perf_counter
    processor: Callable[[], float] = time.process_time
    counters: Callable[[], Counters | None] = counters


@dataclass(frozen=True, eq=False)
class LatencySample:
    """Raw times of a model.

    Attributes:
        phases: Names of the phases, in order.
        raw_ms: (calls, phases) wall time, ms.
        cpu_ms: (calls, phases) processor time of the whole process, ms.
        warm: Whether the warm-up ended by itself.
        warmup_calls: Number of calls of the warm-up.
        threads: Number of threads that the caller set.
        batch: Number of frames in a call.
        load: Load of the machine meanwhile.
    """

    phases: tuple[str, ...]
    raw_ms: npt.NDArray[np.float64]
    cpu_ms: npt.NDArray[np.float64]
    warm: bool
    warmup_calls: int
    threads: int
    batch: int
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
        mean_ms = float(self.total_ms.mean())
        facts = {"scenario": scenario, "threads": self.threads, "batch": self.batch}
        shared = {
            "per_s": 1e3 * self.batch / mean_ms if mean_ms else float("inf"),
            "settled": self.settled,
            "stolen": self.load.stolen,
            "foreign": self.load.foreign,
            "load": self.load.average,
        }
        times = [*self.raw_ms.T, self.total_ms]
        processor = [*self.cpu_ms.T, self.cpu_ms.sum(axis=1)]
        rows = []
        for phase, wall, cpu in zip((*self.phases, "total"), times, processor, strict=True):
            quantiles = zip(("p50_ms", "p90_ms", "p99_ms"), (0.5, 0.9, 0.99), strict=True)
            values = {name: float(np.quantile(wall, share)) for name, share in quantiles}
            values |= {"mean_ms": float(wall.mean()), "cpu_ms": float(cpu.mean())}
            rows.append({**facts, "phase": phase, **values, **shared})
        return rows


def declared_stages(model: Model, frame: Frame) -> list[Stage]:
    """Return the stages that a model declares, after they have answered a frame.

    Raises:
        UserError: They are no pairs of a name and a function with different names, or do not end in
            a list with one answer.
    """
    stages: object = model.stages()
    pairs = list(stages) if isinstance(stages, (list, tuple)) else []
    names = [pair[0] for pair in pairs if isinstance(pair, tuple) and len(pair) == 2]
    called = [name for name in names if isinstance(name, str) and name != "total"]
    if not pairs or len(set(called)) < len(pairs) or not all(callable(pair[1]) for pair in pairs):
        raise UserError(
            "the stages of the model are no list of (name, function) with different names, none "
            f"of them 'total'; fix {describe_method(model, 'stages')}."
        )
    value: Any = [frame]
    for _, stage in pairs:
        value = stage(value)
    if not isinstance(value, Sequence) or len(value) != 1:
        raise UserError(
            f"the model's stage {names[-1]!r} gave {type(value).__name__} where a list with one "
            "answer is asked; the stages of a model must end in what predict answers."
        )
    return pairs


def time_calls(
    models: Mapping[str, Sequence[Stage]],
    frames: Sequence[Any] | Mapping[str, Sequence[Any]],
    batch: int = 1,
    *,
    threads: int,
    calls: int = CALLS,
    budget_s: float | None = None,
    block: int = BLOCK,
    clocks: Clocks = Clocks(),  # noqa: B008 - a constant
    advance: Callable[[int], None] = lambda _: None,
) -> dict[str, LatencySample]:
    """Time the stages of models in turns, so that all meet the same noise.

    Each model warms up first. Then there are rounds in which each model is called ``block`` times.
    A stage is given what the stage before returned, the first one a list of frames.

    Args:
        models: Name -> stages.
        frames: Frames that each model takes in turn, again from the first when they are used up; a
            mapping has the frames of every name.
        batch: Number of frames of a call.
        threads: Number of threads that the caller set.
        calls: Number of calls of each model.
        budget_s: Seconds for each model, after which the rounds end, but never before one is
            finished; the warm-up takes at most half of them. None for no limit.
        block: Number of calls of a block of the warm-up, and of a round.
        clocks: Clocks that are read.
        advance: Function that is called after every round.
    """
    frames_of = frames if isinstance(frames, Mapping) else dict.fromkeys(models, frames)
    sources = {name: _batches(frames_of[name], batch) for name in models}
    raw: dict[str, list[list[float]]] = {name: [] for name in models}
    cpu: dict[str, list[list[float]]] = {name: [] for name in models}
    warm: dict[str, tuple[bool, int]] = {}
    start = clocks.wall()

    def over(budgets: float) -> bool:
        return budget_s is not None and clocks.wall() - start >= budget_s * budgets

    with _no_collection():
        for number, (name, stages) in enumerate(models.items(), start=1):
            late = partial(over, number / 2)
            warm[name] = _warm_up(stages, sources[name], clocks, late, block)
        # Over all rounds: the calls of one model in a round are too short for ticks of 10 ms.
        before = clocks.counters()
        for first in range(0, calls, block):
            if first and over(len(models)):
                break
            for name, stages in models.items():
                for _ in range(min(block, calls - first)):
                    _call(stages, next(sources[name]), clocks, raw[name], cpu[name])
            advance(1)
        load = Load.between(before, clocks.counters())
    return {
        name: LatencySample(
            tuple(phase for phase, _ in stages),
            1e3 * np.array(raw[name]),
            1e3 * np.array(cpu[name]),
            *warm[name],
            threads,
            batch,
            load,
        )
        for name, stages in models.items()
    }


def _batches(frames: Sequence[Any], batch: int) -> Iterator[list[Any]]:
    """Yield lists of ``batch`` frames without end: all in turn, the first ones again at the end."""
    endless = cycle(frames)
    return cycle([list(islice(endless, batch)) for _ in range(-(-len(frames) // batch))])


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


def _warm_up(
    stages: Sequence[Stage],
    source: Iterator[list[Any]],
    clocks: Clocks,
    over: Callable[[], bool],
    block: int,
) -> tuple[bool, int]:
    """Call the stages until two successive blocks agree.

    Returns:
        Whether two blocks agreed, and the number of calls.
    """
    before = float("inf")
    done = 0
    while done < block * WARMUP_BLOCKS and not over():
        raw: list[list[float]] = []
        for _ in range(block):
            _call(stages, next(source), clocks, raw, [])
        done += block
        median = float(np.median([sum(times) for times in raw]))
        if abs(median - before) < SETTLED_WITHIN * before < float("inf"):
            return True, done
        before = median
    return False, done


def _call(
    stages: Sequence[Stage],
    value: Any,
    clocks: Clocks,
    raw: list[list[float]],
    cpu: list[list[float]],
) -> None:
    """Call the stages once; append the wall and processor seconds of every stage."""
    computed, marks = [clocks.processor()], [clocks.wall()]
    for _, stage in stages:
        value = stage(value)
        marks.append(clocks.wall())
        computed.append(clocks.processor())
    raw.append([after - before for before, after in pairwise(marks)])
    cpu.append([after - before for before, after in pairwise(computed)])


@dataclass(frozen=True)
class Speed:
    """Times and cost of a model; empty where it was not timed.

    Attributes:
        rows: Rows of the record.
        raw: Raw times, ms, by name.
        efficiency: Size, operations and memory of the model.
    """

    rows: list[dict[str, Any]] = field(default_factory=list)
    raw: dict[str, np.ndarray] = field(default_factory=dict)
    efficiency: dict[str, Any] = field(default_factory=dict)


def time_models(
    models: Mapping[str, Model],
    frames: Mapping[str, Sequence[Frame]],
    *,
    calls: int = CALLS,
    budget_s: float = BUDGET_S,
    advance: Callable[[int], None] = lambda _: None,
) -> dict[str, Speed]:
    """Time models in turns: at batch 1 with one thread and with all, and in batches with all.

    Args:
        models: Name -> a trained model.
        frames: Name -> frames as the model may see them.
        calls: Number of calls of each model at batch 1.
        budget_s: Seconds for each model and number of threads.
        advance: Function that is called after every scenario: one thread, all, and each batch.

    Raises:
        UserError: A model declares wrong stages.
    """
    stages = {name: declared_stages(model, frames[name][0]) for name, model in models.items()}
    speeds = {name: Speed() for name in models}
    most = all_threads()
    plan: list[tuple[str, int, int]] = [("single", count, 1) for count in sorted({1, most})]
    plan += [("offline", most, batch) for batch in BATCHES]
    with suppress(OSError):  # another system, or a kernel without it
        _RESET.write_text(_RESET_PEAK)
    for scenario, threads, batch in plan:
        single = scenario == "single"
        block = BLOCK if single else BLOCK // 4 if batch <= 8 else 1
        with limited_threads(threads):
            samples = time_calls(
                stages,
                frames,
                batch,
                threads=threads,
                calls=calls if single else OFFLINE_CALLS,
                budget_s=budget_s if single else budget_s / 6,
                block=block,
            )
        label = f"single_{threads}_threads" if single else f"offline_{batch}_frames"
        for name, sample in samples.items():
            speeds[name].rows.extend(sample.rows(scenario))
            speeds[name].raw[f"{label}_ms"] = sample.raw_ms
            speeds[name].raw[f"{label}_cpu_ms"] = sample.cpu_ms
            if single:
                speeds[name].efficiency["peak_memory_mb"] = _peak_mb()
        advance(1)
    return speeds


def time_model(model: Model, frames: Sequence[Frame], *, quick: bool = False) -> Speed:
    """Return the times of a model for test frames, its size, operations and memory.

    Args:
        model: A trained model.
        frames: Test frames.
        quick: Whether to time few calls.

    Raises:
        UserError: The model declares wrong stages.
    """
    seen = [blinded(frames[row]) for row in spread(range(len(frames)), TIMED_FRAMES)]
    if isinstance(model, WorkerModel):
        return model.time(seen, quick=quick)
    calls, budget_s = (QUICK_CALLS, QUICK_BUDGET_S) if quick else (CALLS, BUDGET_S)
    (speed,) = time_models({"": model}, {"": seen}, calls=calls, budget_s=budget_s).values()
    speed.efficiency.update(
        parameters=model.parameter_count(), flops_per_frame=model.flops(seen[0])
    )
    return speed


def _peak_mb() -> float | None:
    """Return the peak of the resident memory, MB (10^6 bytes); None where it is not known.

    Where the kernel cannot reset its count, it is the peak of the whole life of the process.
    """
    with suppress(OSError):
        lines = _STATUS.read_text(encoding="utf-8").splitlines()
        if kib := [int(line.split()[1]) for line in lines if line.startswith("VmHWM:")]:
            return 1.024e-3 * kib[0]
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return 1e-6 * unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
