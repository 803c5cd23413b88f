"""Costs of a row: latency on one machine, weights, operations, memory, training."""

from __future__ import annotations

from typing import Literal

from tactibench.board.rows import Row
from tactibench.records.record import Record


def by_machine(row: Row) -> list[Row]:
    """Return the row once for every machine that its seeds were timed on."""
    groups: dict[str, list[Record]] = {}
    for record in row.records:
        groups.setdefault(machine(record), []).append(record)
    return [Row(tuple(groups[name]), row.mark) for name in sorted(groups)]


def parameters(record: Record) -> float | None:
    """Return the number of trained weights."""
    return record.efficiency.parameters


def operations(record: Record) -> float | None:
    """Return the floating-point operations of one frame."""
    return record.efficiency.flops_per_frame


def memory(record: Record) -> float | None:
    """Return the peak memory, MB."""
    return record.efficiency.peak_memory_mb


def training_seconds(record: Record) -> float | None:
    """Return the seconds that ``fit`` took, in this run or when the weights were made."""
    return record.training.seconds


def frames_per_second(record: Record) -> float | None:
    """Return the frames per second of the fastest batch size and thread count."""
    rates = [row.per_s for row in record.speed if row.phase == "total"]
    return max(rates, default=None)


def difference(record: Record) -> float | None:
    """Median distance of the timed answers from the float32 ones, mm."""
    return record.timed.difference_mm


def latency(
    record: Record,
    *,
    threads: int | None,
    statistic: Literal["p50_ms", "p90_ms"] = "p90_ms",
) -> float | None:
    """Milliseconds from one frame to its contacts; threads None: as many as the machine has.

    None where a run was not timed so.
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
