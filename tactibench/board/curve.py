"""Learning curves: the error of one configuration against the presses that it learned from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tactibench.board.rows import PooledMetric, Row
from tactibench.protocols.board_spec import Ranking


@dataclass(frozen=True)
class Step:
    """A point of a curve. presses: that the model learned from, without those that stop it."""

    presses: int
    error: PooledMetric | None
    seeds: int


@dataclass(frozen=True)
class Curve:
    """One configuration, the fewest presses first."""

    label: str
    model: str
    steps: tuple[Step, ...]


def curves(rows: Iterable[Row], error: Ranking) -> list[Curve]:
    """Return curves of at least two steps, by label.

    rows: of one sensor, with and without ``presses``.
    """
    by_label: dict[str, list[Row]] = {}
    for row in rows:
        by_label.setdefault(row.label, []).append(row)
    return [
        Curve(label, several[0].first.model.name, _steps(several, error))
        for label, several in sorted(by_label.items())
        if len(several) > 1
    ]


def _steps(rows: Iterable[Row], error: Ranking) -> tuple[Step, ...]:
    steps = [
        Step(row.first.data.train, row.metric(error.metric, error.group), len(row.records))
        for row in rows
    ]
    return tuple(sorted(steps, key=lambda step: step.presses))


def counts(curves: Sequence[Curve]) -> list[int]:
    """Return all numbers of presses, ascending."""
    return sorted({step.presses for curve in curves for step in curve.steps})
