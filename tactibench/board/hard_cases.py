"""Hard cases on a board: the case where a model's error doubles, and its error case by case."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from tactibench.board.rows import PooledMetric, Row
from tactibench.protocols import Axis

ERROR = "ospa_mm"
DECIMALS = 3


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
