"""A model on several boards: its errors on hard cases, and one line for all protocols."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from tactibench.board.rows import (
    PooledMetric,
    Row,
    rows_of,
    trained_for,
    training_sensor,
    whole,
)
from tactibench.protocols import Axis, load_protocol, overview_spec
from tactibench.records import Record, canonical

ERROR = "ospa_mm"


@dataclass(frozen=True)
class Case:
    """One case of one row.

    Attributes:
        value: Value of the family's axis.
        easy: Whether it is the reference of its family.
        error: OSPA, mm.
        missed: Share of contacts missed.
        spurious: Spurious contacts.
        ratio: Error over that of the reference.
    """

    value: float
    easy: bool
    error: PooledMetric | None
    missed: PooledMetric | None
    spurious: PooledMetric | None
    ratio: PooledMetric | None


@dataclass(frozen=True)
class FamilyErrors:
    """The errors of one row of a board on a family of hard cases.

    Attributes:
        axis: Axis of the family.
        cases: Cases of the family, the easy one first where there is one.
        doubles: Value at which the error doubles.
    """

    axis: Axis
    cases: tuple[Case, ...]
    doubles: PooledMetric | None

    @property
    def worst(self) -> PooledMetric | None:
        """The largest ratio of all cases; None where no case has one."""
        ratios = [case.ratio for case in self.cases if case.ratio is not None]
        return max(ratios, key=lambda ratio: ratio.value, default=None)


def family_errors(row: Row, axes: Iterable[Axis]) -> list[FamilyErrors]:
    """Return the errors of a row on all families, in the order of the protocol."""
    return [_family_errors(row, axis) for axis in axes]


def _family_errors(row: Row, axis: Axis) -> FamilyErrors:
    groups = list(zip(axis.values, axis.groups, strict=True))
    if axis.easy is not None:
        groups.insert(0, (axis.easy, axis.reference))
    cases = tuple(
        Case(
            value,
            group == axis.reference,
            row.metric(ERROR, group),
            row.metric("missed", group),
            row.metric("spurious", group),
            row.metric("error_ratio", group),
        )
        for value, group in groups
    )
    return FamilyErrors(axis, cases, row.metric("doubles_at", axis.family))


@dataclass(frozen=True)
class OverviewLine:
    """A model on several boards.

    Attributes:
        row: Row of the protocol whose rows are the lines.
        values: One value a column, None where the model has no row or its row no value.
    """

    row: Row
    values: tuple[PooledMetric | None, ...]


def overview(records: Mapping[str, Iterable[Record]]) -> list[OverviewLine]:
    """Return the lines of the overview, in its order; trivial models last.

    Args:
        records: Records of the present version of each protocol, by its id.
    """
    spec = overview_spec()
    boards = {name: rows_of(whole(trained_for(of_board))) for name, of_board in records.items()}
    trained = {name: {_training(row): row for row in rows} for name, rows in boards.items()}
    real = {name: {_on_recording(row): row for row in rows} for name, rows in boards.items()}
    usual, lines = next(iter(load_protocol(spec.protocol).spec.regimes)), []
    for row in boards.get(spec.protocol, ()):
        if row.first.sensor.origin != "simulated":
            continue
        values = []
        for column in spec.columns:
            match = trained.get(column.protocol, {}).get(_training(row))
            if column.recording:
                wanted = canonical([column.recording, *_model(row)])
                found = real.get(column.protocol, {})  # of single contacts, as all recordings are
                match = found.get(wanted) if row.regime == usual else None
            values.append(None if match is None else match.metric(column.metric, column.group))
        lines.append(OverviewLine(row, tuple(values)))
    names = [column.name for column in spec.columns]

    def place(line: OverviewLine) -> tuple[bool, list[float]]:
        values = [line.values[names.index(name)] for name in spec.order]
        return line.row.trivial, [math.inf if value is None else value.value for value in values]

    return sorted(lines, key=place)


def _model(row: Row) -> list[Any]:
    """Return the model and its encoder, as JSON values."""
    encoder = row.first.encoder
    return [row.first.model.identity, None if encoder is None else encoder.identity]


def _on_recording(row: Row) -> str:
    """Return the recording of a row, "" for none, and its model, which find it."""
    recording = row.first.sensor.recording
    return canonical(["" if recording is None else recording.sha256[:8], *_model(row)])


def _training(row: Row) -> str:
    """Return what rows of one training share: sensor, model, encoder and regime."""
    return canonical([*training_sensor(row.first), *_model(row), row.first.regime])
