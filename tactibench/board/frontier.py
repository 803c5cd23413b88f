"""Speed against error: the models on the frontier, and the models that dominate others.

A point is dominated only when another is better on both axes by more than the intervals. Both axes
take the envelope of the seeds: from the lowest end of their intervals to the highest. A p90 has no
interval of its own; it is taken to be uncertain by the 2 % to which a warm-up settles. Each regime
has its own frontier: a model that saw fewer kinds of presses answered another question. Trivial
rows are on none.
"""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from tactibench.board.cost import latency, machine
from tactibench.board.rows import Row
from tactibench.protocols import Ranking

SETTLED = 0.02
"""Relative. A warm-up ends when two blocks of calls differ by less; so times that differ by less
cannot be told apart."""


@dataclass(frozen=True)
class Range:
    """A value with the ends of the range in which it may lie."""

    value: float
    low: float
    high: float

    def below(self, other: Range) -> bool:
        """Return whether this range lies below the other one."""
        return self.high < other.low


@dataclass(frozen=True)
class Point:
    """A row of a board, as a point.

    Attributes:
        row: Row of the board.
        latency: p90 of one frame on one thread, ms.
        error: Error that ranks the rows.
    """

    row: Row
    latency: Range
    error: Range

    @property
    def label(self) -> str:
        """The label of the row without its regime, which is that of the frontier."""
        return self.row.short


@dataclass(frozen=True)
class Frontier:
    """Points of one regime, sorted by latency.

    Attributes:
        regime: Training regime.
        points: All points.
        best: Points whose central values no other point beats on both axes, sorted by latency: the
            line.
        dominated: Label -> labels of the points that dominate it, the fastest first.
        machine: Machine on which all points were timed.
        elsewhere: Number of runs that were timed on another machine.
        untimed: Labels of rows without an error or a time.
    """

    regime: str
    points: tuple[Point, ...]
    best: tuple[Point, ...]
    dominated: dict[str, tuple[str, ...]]
    machine: str
    elsewhere: int
    untimed: tuple[str, ...]

    def verdict(self, point: Point) -> str:
        """Return "frontier", "dominated by X", or "not dominated", which intervals leave open."""
        by = self.dominated.get(point.label, ())
        if by:
            more = f" and {len(by) - 1} more" if len(by) > 1 else ""
            return f"dominated by {by[0]}{more}"
        return "frontier" if point in self.best else "not dominated"


def frontiers(rows: Iterable[Row], error: Ranking, wanted: str | None = None) -> list[Frontier]:
    """Return the frontier of every regime among the rows that were timed on one machine.

    Args:
        rows: Rows of one section.
        error: Error that ranks the rows.
        wanted: Fingerprint of the machine; None: the machine of most runs.
    """
    candidates = [row for row in rows if not row.trivial]
    timed_on = wanted or busiest(candidates)
    regimes = sorted({row.regime for row in candidates}, reverse=True)  # "single" before "multiple"
    return [
        _of_regime(name, [r for r in candidates if r.regime == name], error, timed_on)
        for name in regimes
    ]


def _of_regime(regime: str, rows: Sequence[Row], error: Ranking, timed_on: str) -> Frontier:
    points, untimed, elsewhere = [], [], 0
    for row in rows:
        timed = _timed_on(row, timed_on)
        elsewhere += len(row.records) - len(timed.records)
        if not timed.records:
            continue
        times, errors = _latency(timed), _error(timed, error.metric, error.group)
        if times is None or errors is None:
            untimed.append(row.short)
        else:
            points.append(Point(timed, times, errors))
    points.sort(key=lambda point: (point.latency.value, point.error.value, point.label))
    dominated = {point.label: by for point in points if (by := _dominators(point, points))}
    return Frontier(
        regime,
        tuple(points),
        tuple(line(points)),
        dominated,
        timed_on,
        elsewhere,
        tuple(untimed),
    )


def elsewhere_frontiers(
    nominal: Sequence[Frontier], rows: Iterable[Row], error: Ranking
) -> list[Frontier]:
    """Return the same configurations with their errors on other test frames, in the same order.

    The times are those of the nominal frontiers: the same weights cost the same elsewhere.

    Args:
        nominal: Frontiers of the section where the configurations were timed.
        rows: Rows of the section with the other test frames.
        error: Error on these frames.
    """
    by_label = {(row.regime, row.short): row for row in rows if not row.trivial}
    moved = []
    for frontier in nominal:
        points = []
        for point in frontier.points:
            row = by_label.get((frontier.regime, point.label))
            value = None if row is None else _error(row, error.metric, error.group)
            if row is not None and value is not None:
                points.append(Point(row, point.latency, value))
        dominated = {point.label: by for point in points if (by := _dominators(point, points))}
        best = tuple(line(points))
        moved.append(replace(frontier, points=tuple(points), best=best, dominated=dominated))
    return moved


def busiest(rows: Iterable[Row]) -> str:
    """Return the machine of most runs, of equal ones the first by name; "" without runs."""
    counts = Counter(machine(record) for row in rows for record in row.records)
    return min(counts, key=lambda name: (-counts[name], name), default="")


def line(points: Sequence[Point]) -> list[Point]:
    """Return the points that no other beats on both central values, sorted by latency."""
    best: list[Point] = []
    for point in sorted(points, key=lambda p: (p.latency.value, p.error.value)):
        if not best or point.error.value < best[-1].error.value:
            best.append(point)
    return best


def _timed_on(row: Row, timed_on: str) -> Row:
    return Row(tuple(r for r in row.records if machine(r) == timed_on), row.mark)


def _dominators(point: Point, points: Iterable[Point]) -> tuple[str, ...]:
    return tuple(
        other.label
        for other in points
        if other.latency.below(point.latency) and other.error.below(point.error)
    )


def _latency(row: Row) -> Range | None:
    times = row.over(lambda record: latency(record, threads=1))
    if len(times) < len(row.records):
        return None
    value = statistics.fmean(times)
    return Range(value, min(*times, value * (1 - SETTLED)), max(*times, value * (1 + SETTLED)))


def _error(row: Row, metric: str, group: str) -> Range | None:
    """Return the mean over seeds in the envelope of their intervals; None where a seed is n/a."""
    pooled = row.metric(metric, group)
    if pooled is None or pooled.censored:
        return None
    single = [Row((record,)).metric(metric, group) for record in row.records]
    ends = [
        (
            of_seed.value if of_seed.low is None else of_seed.low,
            of_seed.value if of_seed.high is None else of_seed.high,
        )
        for of_seed in single
        if of_seed is not None
    ]
    return Range(pooled.value, min(low for low, _ in ends), max(high for _, high in ends))
