"""Rows of a board: one model in one configuration, its training seeds pooled.

Value: mean over seeds. Interval: mean of the seeds' intervals, end by end. The seeds answer the
same presses, and the standard deviation of a mean is at most the mean of the standard deviations
(Minkowski), so this interval covers the sampling of presses at least as often as it says. It holds
nothing of the seeds' own spread, which is ``sd``: their sample standard deviation.
"""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from tactibench.board.labels import MIXING, TRIVIAL, label_of, mixing_of, row_key
from tactibench.records.identity import canonical, digest
from tactibench.records.record import Record


@dataclass(frozen=True)
class Pooled:
    """A number over seeds. clusters: presses behind it in one seed, the fewest and the most."""

    value: float
    low: float | None
    high: float | None
    sd: float | None
    clusters: tuple[int, int]
    unit: str
    censored: str | None = None


@dataclass(frozen=True)
class Row:
    """The seeds of one configuration, by seed.

    mark: tells rows apart whose parameters differ although their labels do not.
    """

    records: tuple[Record, ...]
    mark: str = ""

    @property
    def first(self) -> Record:
        return self.records[0]

    @property
    def seeds(self) -> tuple[int, ...]:
        return tuple(record.seed for record in self.records)

    @property
    def label(self) -> str:
        return label_of(self.first) + self.mark

    @property
    def short(self) -> str:
        """The label without the regime."""
        return self.label.replace(f" ({self.regime})", "")

    @property
    def model(self) -> str:
        """The model with its parameters, without mixing, which has a column of its own."""
        return self.first.model.text(without=MIXING) + self.mark

    @property
    def encoder(self) -> str:
        encoder = self.first.encoder
        return "" if encoder is None else encoder.text()

    @property
    def regime(self) -> str:
        return self.first.regime

    @property
    def mixing(self) -> str:
        return mixing_of(self.first)

    @property
    def presses(self) -> int | None:
        return self.first.limits.presses

    @property
    def trivial(self) -> bool:
        return self.first.model.name in TRIVIAL

    def metric(self, metric: str, group: str) -> Pooled | None:
        """The metric over all seeds; None where one seed has no value: the others would flatter."""
        rows = [row for record in self.records if (row := record.metric(metric, group))]
        values = [row.value for row in rows if row.value is not None]
        if not values or len(values) < len(self.records):
            return None
        marks = {row.censored for row in rows if row.censored}
        if len(marks) > 1:
            return None
        counts = [row.clusters for row in rows]
        return Pooled(
            statistics.fmean(values),
            _mean_or_none([row.low for row in rows]),
            _mean_or_none([row.high for row in rows]),
            statistics.stdev(values) if len(values) > 1 and not marks else None,
            (min(counts), max(counts)),
            rows[0].unit,
            next(iter(marks), None),
        )

    def over(self, quantity: Callable[[Record], float | None]) -> list[float]:
        """A quantity of every seed that has it."""
        return [value for record in self.records if (value := quantity(record)) is not None]


def rows_of(records: Iterable[Record]) -> list[Row]:
    """Records with their seeds pooled, in the order of their labels."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(canonical(row_key(record)), []).append(record)
    seeds = [tuple(sorted(found, key=lambda r: r.seed)) for found in groups.values()]
    labels = Counter(_shown(records[0]) for records in seeds)
    rows = [Row(records, _mark(records[0], labels)) for records in seeds]
    return sorted(rows, key=lambda row: (row.label, row.presses or 0))


def _mark(record: Record, labels: Mapping[tuple[str, int | None], int]) -> str:
    return f" #{digest(row_key(record))[:4]}" if labels[_shown(record)] > 1 else ""


def _shown(record: Record) -> tuple[str, int | None]:
    return label_of(record), record.limits.presses


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
    """Fingerprint of the hardware that a record was timed on."""
    return record.environment.fingerprint


def _mean_or_none(ends: Sequence[float | None]) -> float | None:
    known = [end for end in ends if end is not None]
    return statistics.fmean(known) if known and len(known) == len(ends) else None
