"""Costs of a row: latency on one machine, weights, operations, memory, training."""

from __future__ import annotations

from typing import Literal

from tactibench.board.rows import Row
from tactibench.records import Record, SpeedRow
from tactibench.run import Load


def by_machine(row: Row) -> list[Row]:
    """Return the row divided by machine: one row for every machine that its seeds were timed on."""
    groups: dict[str, list[Record]] = {}
    for record in row.records:
        groups.setdefault(machine(record), []).append(record)
    return [Row(tuple(groups[name]), row.mark) for name in sorted(groups)]


def frames_per_second(record: Record) -> float | None:
    """Return the frames per second of the fastest batch size and thread count."""
    rates = [row.per_s for row in record.speed if row.phase == "total"]
    return max(rates, default=None)


def latency(
    record: Record,
    *,
    threads: int | None,
    statistic: Literal["p50_ms", "p90_ms"] = "p90_ms",
) -> float | None:
    """Return the milliseconds from one frame to its contacts; None where a run was not timed so.

    Args:
        record: Record of the run.
        threads: Number of threads; None: the largest number that was timed.
        statistic: Quantile of the times.
    """
    totals = [
        row
        for row in record.speed
        if (row.scenario, row.batch, row.phase) == ("single", 1, "total")
    ]
    if threads is None:
        threads = max((row.threads for row in totals), default=0)
    return next((getattr(row, statistic) for row in totals if row.threads == threads), None)


def machine(record: Record) -> str:
    """Return the fingerprint of the hardware that a record was timed on."""
    return record.environment.fingerprint


def settled_time(speed: SpeedRow) -> bool:
    """Return whether a time is settled: its record says so, and others took little meanwhile.

    Records of earlier code say so of one thread, too, beside which a training ran.
    """
    return speed.settled and Load(speed.stolen, speed.foreign).quiet is not False


def settled(row: Row) -> bool:
    """Return whether the times of a row for single frames on one thread are settled."""
    return all(
        settled_time(speed)
        for record in row.records
        for speed in record.speed
        if (speed.scenario, speed.threads) == ("single", 1)
    )
