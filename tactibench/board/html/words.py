"""Words about a row that several figures say alike."""

from __future__ import annotations

from tactibench.board.numbers import number, significant
from tactibench.board.rows import Row, latency, machine
from tactibench.records.record import Record

MISSES = (("missed", "missed"), ("resolved", "resolved as two"), ("coverage", "answered"))
"""What an error is never shown without: the first of these that a row has."""


def with_interval(
    value: float, low: float | None, high: float | None, decimals: int, scale: float = 1.0
) -> str:
    """ "0.412 [0.398, 0.426]"; an end that is not known reads "open"."""
    ends = ("open" if end is None else number(end * scale, decimals) for end in (low, high))
    return f"{number(value * scale, decimals)} [{', '.join(ends)}]"


def beside(row: Row) -> str:
    """ "missed 0.17 %": of all frames; "" where the row counts no misses."""
    for metric, words in MISSES:
        for group in ("all", "0"):
            found = row.metric(metric, group)
            if found is not None:
                return f"{words} {number(100 * found.value, 2)} %"
    return ""


def seeds_words(row: Row) -> str:
    """ "3 seeds", "1 seed (0)"."""
    named = ", ".join(str(seed) for seed in row.seeds)
    return f"{len(row.seeds)} seed{'' if len(row.seeds) == 1 else 's'} ({named})"


def p90_words(row: Row) -> str:
    """ "5.2 ms", the mean over seeds, where all were timed on one machine."""
    times = row.over(lambda record: latency(record, threads=1))
    if not times or len({machine(record) for record in row.records}) > 1:
        return "n/a"
    return f"{significant(sum(times) / len(times))} ms"


def machine_words(record: Record) -> str:
    """ "AMD EPYC, 2 cores (2814b7530aaa)"."""
    found = record.environment
    cores = found.cores_logical
    parts = [
        found.cpu or "unknown",
        f"{cores} cores" if cores else "",
        *(str(gpu) for gpu in found.gpu),
    ]
    return f"{', '.join(filter(None, parts))} ({machine(record)})"
