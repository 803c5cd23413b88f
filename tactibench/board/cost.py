"""What an error costs: latency inside one hardware fingerprint, weights, operations, training."""

from __future__ import annotations

from tactibench.board.rows import Row, machine
from tactibench.records.record import Record


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
