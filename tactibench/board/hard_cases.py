"""Hard cases on a board: where every model's error doubles, and its error case by case."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from tactibench.board.rows import Pooled, Row
from tactibench.protocols.families import Axis

ERROR = "ospa_mm"
DECIMALS = 3


@dataclass(frozen=True)
class Case:
    """One case of one row. easy: whether it is the reference of its family."""

    value: float
    easy: bool
    error: Pooled | None
    missed: Pooled | None
    spurious: Pooled | None
    ratio: Pooled | None


@dataclass(frozen=True)
class Graded:
    """A family as one row of a board did on it, the easy case first, where there is one."""

    axis: Axis
    cases: tuple[Case, ...]
    doubles: Pooled | None

    @property
    def worst(self) -> Pooled | None:
        """The largest ratio."""
        known = [case.ratio for case in self.cases if case.ratio is not None]
        return max(known, key=lambda ratio: ratio.value, default=None)


def graded(row: Row, axes: Iterable[Axis]) -> list[Graded]:
    """All families of a row, in the order of the protocol."""
    return [_graded(row, axis) for axis in axes]


def _graded(row: Row, axis: Axis) -> Graded:
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
    return Graded(axis, cases, row.metric("doubles_at", axis.family))
