"""What an error costs: latency inside one hardware fingerprint, weights, operations, training."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Sequence

from tactibench.board.markdown import Head, code, plain, table
from tactibench.board.numbers import duration, number, scaled, significant
from tactibench.board.rows import Row, latency, machine
from tactibench.board.tables import IDENTITY, MISSING, deviation, identity
from tactibench.records.record import Record

LATENCY = (
    Head("p90, ms"),
    Head("sd"),
    Head("p50, ms"),
    Head("p90, all threads, ms"),
    Head("frames/s"),
    Head("to float32, mm"),
    Head("timed as", right=False),
    Head("machine", right=False),
)
LATENCY_NOTE = (
    "One frame to contacts in mm, batch 1, one thread where nothing else is said; mean over seeds. "
    "frames/s: the best batch. To float32: median distance of the timed configuration's answers "
    "from the float32 ones, which are scored. Times may be compared inside one machine only. "
    "\\*: still drifting when the warm-up ended."
)
COST = (
    Head("weights"),
    Head("operations"),
    Head("memory, MB"),
    Head("training"),
    Head("sd, s"),
    Head("trained on", right=False),
    Head("machine", right=False),
)
COST_NOTE = (
    "Operations: floating-point, of one frame. Memory: peak of the whole process while it was "
    "timed. Training: the experiments share their weights; a run that found them in the cache "
    "shows the time that they took."
)


def cost_lines(rows: Sequence[Row]) -> list[str]:
    """Tables of latency and cost, and the machines behind the fingerprints."""
    split = [part for row in rows for part in by_machine(row)]
    latencies = [[*identity(row), *_latency_cells(row)] for row in split]
    costs = [[*identity(row), *_cost_cells(row)] for row in split]
    machines = {machine(record): _machine(record) for row in rows for record in row.records}
    named = [f"- {code(name)}: {text}" for name, text in sorted(machines.items())]
    return [
        "### Latency",
        "",
        *table([*IDENTITY, *LATENCY], latencies),
        "",
        LATENCY_NOTE,
        "",
        "### Cost",
        "",
        *table([*IDENTITY, *COST], costs),
        "",
        COST_NOTE,
        "",
        *named,
        "",
    ]


def by_machine(row: Row) -> list[Row]:
    """The row once for every machine that its seeds were timed on."""
    groups: dict[str, list[Record]] = {}
    for record in row.records:
        groups.setdefault(machine(record), []).append(record)
    return [Row(tuple(groups[name]), row.mark) for name in sorted(groups)]


def parameters(record: Record) -> float | None:
    """Number of trained weights."""
    return record.efficiency.parameters


def operations(record: Record) -> float | None:
    """Floating-point operations of one frame."""
    return record.efficiency.flops_per_frame


def memory(record: Record) -> float | None:
    """Peak memory, MB."""
    return record.efficiency.peak_memory_mb


def training_seconds(record: Record) -> float | None:
    """Seconds that ``fit`` took, in this run or when the weights were made."""
    return record.training.seconds


def frames_per_second(record: Record) -> float | None:
    """Of the batch size and thread count that make the most of the machine."""
    rates = [row.per_s for row in record.speed if row.phase == "total"]
    return max(rates, default=None)


def difference(record: Record) -> float | None:
    """Median distance of the timed answers from the float32 ones, mm."""
    return record.timed.difference_mm


def _latency_cells(row: Row) -> Iterable[str]:
    times = row.over(lambda record: latency(record, threads=1))
    sd = deviation(times)
    yield _mean(times, significant) + ("" if _settled(row) else "\\*")
    yield MISSING if sd is None else significant(sd, 2)
    yield _mean(row.over(lambda r: latency(r, threads=1, statistic="p50_ms")), significant)
    yield _mean(row.over(lambda r: latency(r, threads=None)), significant)
    yield _mean(row.over(frames_per_second), lambda value: f"{value:,.0f}")
    yield _mean(row.over(difference), lambda value: number(value, 4))
    yield _words(row, lambda record: record.timed.configuration)
    yield code(machine(row.first))


def _cost_cells(row: Row) -> Iterable[str]:
    seconds = row.over(training_seconds)
    sd = deviation(seconds)
    yield _mean(row.over(parameters), scaled)
    yield _mean(row.over(operations), scaled)
    yield _mean(row.over(memory), lambda value: f"{value:,.0f}")
    yield _mean(seconds, duration)
    yield MISSING if sd is None else f"{sd:,.0f}"
    yield _words(row, lambda record: record.training.device)
    yield code(machine(row.first))


def _words(row: Row, said: Callable[[Record], str | None]) -> str:
    """What the records say, each thing once."""
    return plain("; ".join(sorted({said(record) or MISSING for record in row.records})))


def _mean(values: Sequence[float], text: Callable[[float], str]) -> str:
    return text(statistics.fmean(values)) if values else MISSING


def _settled(row: Row) -> bool:
    return all(
        speed.settled
        for record in row.records
        for speed in record.speed
        if (speed.scenario, speed.threads) == ("single", 1)
    )


def _machine(record: Record) -> str:
    facts = record.environment
    cores, torch = facts.cores_logical, facts.torch
    parts = [
        facts.cpu,
        f"{cores} logical cores" if cores else None,
        ", ".join(facts.cpu_flags),
        *facts.gpu,
        f"torch {torch}" if torch else None,
        facts.os,
    ]
    return plain("; ".join(part for part in parts if part))
