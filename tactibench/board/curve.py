"""Learning curves: the error of one configuration against the presses that it learned from.

For a new sensor these are labelled presses of it: a model that was trained on other sensors adapts
to them, or a model is trained on them alone.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tactibench.board.rows import PooledMetric, Row, label_of
from tactibench.plugins import INSTANCE
from tactibench.protocols import Ranking
from tactibench.records import Record, Value

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
    """Return the curves of at least two steps, sorted by label.

    Args:
        rows: Rows of one sensor, with and without ``presses``.
        error: Error that is drawn.
    """
    by_label: dict[str, list[Row]] = {}
    for row in rows:
        by_label.setdefault(row.label, []).append(row)
    return [
        Curve(label, same_label[0].first.model.name, _steps(same_label, error))
        for label, same_label in sorted(by_label.items())
        if len(same_label) > 1
    ]


def _steps(rows: Iterable[Row], error: Ranking) -> tuple[Step, ...]:
    steps = [
        Step(row.first.data.train, row.metric(error.metric, error.group), len(row.records))
        for row in rows
    ]
    return tuple(sorted(steps, key=lambda step: step.presses))


def new_sensor_curves(records: Iterable[Record], error: Ranking, sensor: str) -> list[Curve]:
    """Return the curves of at least two steps over the instances of a sensor, sorted by label.

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
    for (label, model), steps in sorted(points.items()):
        # Means over fewer instances than the others' would compare instances, not presses.
        complete = [n for n in sorted(steps) if len(steps[n]) == max(map(len, steps.values()))]
        if len(complete) > 1:
            curves.append(
                Curve(label, model, tuple(_mean_step(n, steps[n], error) for n in complete))
            )
    return curves


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
    rows = [
        [row for record in runs if (row := record.metric(error.metric, error.group)) is not None]
        for runs in by_instance.values()
    ]
    values = [
        statistics.fmean(row.value for row in seeds if row.value is not None)
        for seeds in rows
        if any(row.value is not None for row in seeds)
    ]
    runs = sum(map(len, by_instance.values()))
    if not values:
        return Step(presses, None, runs)
    sizes = [row.clusters for seeds in rows for row in seeds]
    pooled = PooledMetric(
        statistics.fmean(values),
        min(values),
        max(values),
        statistics.stdev(values) if len(values) > 1 else None,
        (min(sizes), max(sizes)),
        rows[0][0].unit,
    )
    return Step(presses, pooled, runs)


def counts(curves: Sequence[Curve]) -> list[int]:
    """Return all numbers of presses of the curves, ascending."""
    return sorted({step.presses for curve in curves for step in curve.steps})
