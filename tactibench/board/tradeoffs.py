"""Speed against error, and error against the presses that a model learned from.

A point is dominated only when another is better on both axes by more than the intervals. Both axes
take the envelope of the seeds: from the lowest end of their intervals to the highest. A p90 has no
interval of its own; it is taken to be uncertain by the 2 % to which a warm-up settles. Each regime
has its own frontier: a model that saw fewer kinds of presses answered another question. Trivial
rows are on none.

A learning curve is the error of one configuration against its presses. For a new sensor these are
labelled presses of it: a model that was trained on other sensors adapts to them, or a model is
trained on them alone.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from tactibench.board.rows import PooledMetric, Row, label_of, latency, machine
from tactibench.plugins import INSTANCE
from tactibench.protocols import Ranking
from tactibench.records import Record, Value

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
        machine: Machine on which all points were timed.
        elsewhere: Number of runs that were timed on another machine.
        untimed: Labels of rows without an error or a time.
    """

    regime: str
    points: tuple[Point, ...]
    machine: str
    elsewhere: int
    untimed: tuple[str, ...]

    @cached_property
    def best(self) -> tuple[Point, ...]:
        """The line: points that no other one beats on both central values, by latency."""
        return tuple(line(self.points))

    @cached_property
    def dominated(self) -> dict[str, tuple[str, ...]]:
        """Label -> labels of the points that dominate it, the fastest first."""
        return {p.label: by for p in self.points if (by := _dominators(p, self.points))}

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
    return Frontier(regime, tuple(points), timed_on, elsewhere, tuple(untimed))


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
        moved.append(replace(frontier, points=tuple(points)))
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
    seeds = [record.metric(metric, group) for record in row.records]
    known = [(m.value, m.low, m.high) for m in seeds if m is not None and m.value is not None]
    lows = [value if low is None else low for value, low, _ in known]
    highs = [value if high is None else high for value, _, high in known]
    return Range(pooled.value, min(lows), max(highs))


INSTANCES = "instances"
"""Parameter of a sensor: number of instances of its make that the training presses are from."""


@dataclass(frozen=True)
class Step:
    """A point of a curve.

    Attributes:
        presses: Number of presses that the model learned from, without the validation presses.
        error: Error that orders the board; None where it has no value.
        seeds: Number of training seeds; for a new sensor, number of runs on its instances.
    """

    presses: int
    error: PooledMetric | None
    seeds: int


@dataclass(frozen=True)
class Curve:
    """One configuration, the fewest presses first.

    Attributes:
        label: Label of the configuration.
        model: Name of the model.
        steps: Points of the curve.
    """

    label: str
    model: str
    steps: tuple[Step, ...]


def curves(rows: Iterable[Row], error: Ranking) -> list[Curve]:
    """Return the curves of at least two steps, the smallest error of a last step first.

    Args:
        rows: Rows of one sensor, with and without ``presses``.
        error: Error that is drawn.
    """
    by_label: dict[str, list[Row]] = {}
    for row in rows:
        by_label.setdefault(row.label, []).append(row)
    found = [
        Curve(label, same_label[0].first.model.name, _steps(same_label, error))
        for label, same_label in by_label.items()
        if len(same_label) > 1
    ]
    return sorted(found, key=_last_error)


def _last_error(curve: Curve) -> tuple[float, str]:
    last = curve.steps[-1].error
    return math.inf if last is None else last.value, curve.label


def _steps(rows: Iterable[Row], error: Ranking) -> tuple[Step, ...]:
    steps = [
        Step(row.first.data.train, row.metric(error.metric, error.group), len(row.records))
        for row in rows
    ]
    return tuple(sorted(steps, key=lambda step: step.presses))


def new_sensor_curves(records: Iterable[Record], error: Ranking, sensor: str) -> list[Curve]:
    """Return the curves of at least two steps over a sensor's instances, ordered as ``curves``.

    A point is the mean over these instances; its ends are the smallest and the largest. A point
    over fewer instances than the others of its curve is left out. Presses are labelled presses of
    the instance: those that a model trained on others was shown, or those that a model was trained
    on alone.

    Args:
        records: Records with and without a test sensor.
        error: Error that is drawn.
        sensor: Name of the sensor; runs with other settings of it are left out.
    """
    records = [record for record in records if record.sensor.name == sensor and _as_made(record)]
    shown = [(record, instance) for record in records if (instance := _unseen_instance(record))]
    unseen = {instance for _, instance in shown}
    trained_on_it = [
        (record, instance)
        for record in records
        if record.test_sensor is None
        and (instance := record.sensor.parameters.get(INSTANCE, 0)) in unseen
    ]
    points: dict[tuple[str, str], dict[int, dict[Value, list[Record]]]] = {}
    for record, instance in (*shown, *trained_on_it):
        if record.test_sensor is None:
            how, presses = "this sensor alone", record.data.train
        else:
            count = record.sensor.parameters.get(INSTANCES, 0)
            how, presses = (
                f"trained on {count} others" if count else "trained on another",
                record.shots,
            )
        curve = points.setdefault(
            (f"{label_of(record, shots=False)}, {how}", record.model.name), {}
        )
        curve.setdefault(presses, {}).setdefault(instance, []).append(record)
    curves = []
    for (label, model), steps in points.items():
        # Means over fewer instances than the others' would compare instances, not presses.
        complete = [n for n in sorted(steps) if len(steps[n]) == max(map(len, steps.values()))]
        if len(complete) > 1:
            curves.append(
                Curve(label, model, tuple(_mean_step(n, steps[n], error) for n in complete))
            )
    return sorted(curves, key=_last_error)


def _as_made(record: Record) -> bool:
    """Return whether no other parameter of the sensors than their instances was changed."""
    allowed, trained = {INSTANCE, INSTANCES}, record.sensor.parameters
    tested = trained if record.test_sensor is None else record.test_sensor.parameters
    others = {name for name in {*trained, *tested} if trained.get(name) != tested.get(name)}
    return {*record.sensor.changed, *others} <= allowed


def _unseen_instance(record: Record) -> Value:
    """Return the number of the instance that a model was tested on but not trained on; 0: none."""
    test = record.test_sensor
    if test is None or test.name != record.sensor.name:
        return 0
    instance = test.parameters.get(INSTANCE, 0)
    return 0 if instance == record.sensor.parameters.get(INSTANCE, 0) else instance


def _mean_step(presses: int, by_instance: dict[Value, list[Record]], error: Ranking) -> Step:
    """Return one point of a curve, pooled over the seeds of an instance, then over instances."""
    pooled = [
        metric
        for seeds in by_instance.values()
        if (metric := Row(tuple(seeds)).metric(error.metric, error.group)) is not None
    ]
    runs = sum(map(len, by_instance.values()))
    if not pooled:
        return Step(presses, None, runs)
    values = [metric.value for metric in pooled]
    sizes = [size for metric in pooled for size in metric.clusters]
    mean = PooledMetric(
        statistics.fmean(values),
        min(values),
        max(values),
        statistics.stdev(values) if len(values) > 1 else None,
        (min(sizes), max(sizes)),
        pooled[0].unit,
    )
    return Step(presses, mean, runs)


def counts(curves: Sequence[Curve]) -> list[int]:
    """Return all numbers of presses of the curves, ascending."""
    return sorted({step.presses for curve in curves for step in curve.steps})
