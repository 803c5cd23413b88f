"""Tables of hard cases: where errors double, and the error case by case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tactibench.board import ERROR, Case, FamilyErrors, PooledMetric, Row, family_errors
from tactibench.protocols import Axis
from tactibench.report.board_tables import IDENTITY, identity
from tactibench.report.document import Block, Group, Heading, prose
from tactibench.report.numbers import fixed, general, number
from tactibench.report.table import Cell, Column, Head, Number, Table, table

WITH_INTERVALS = 2
"""Most models whose intervals fit beside each other."""
DOUBLING_NOTE = (
    "Value at which the error is twice that of the easy case, linear between the cases; below "
    'it, where the ends of the ratios\' 95 % intervals reach two. "<", ">": not doubled at '
    "the hardest case, which stands behind it. n/a: the easy case costs more than half the "
    "gate already. A model with a small error doubles it early: "
    "the error itself stands below."
)


def hard_case_blocks(rows: Sequence[Row], axes: Sequence[Axis]) -> list[Block]:
    """Return tables of doubling points and of the error case by case.

    Families that change the press stand apart from families of faults. Empty for a protocol without
    families.

    Args:
        rows: Rows of a board.
        axes: Axes of the protocol's families.
    """
    if not axes:
        return []
    families = [family_errors(row, axes) for row in rows]
    pressed = [a for a in axes if a.ordered and a.reference.startswith(f"{a.family}:")]
    faults = [axis for axis in axes if axis.ordered and axis not in pressed]
    note = (
        f"`{ERROR}`, the easy case first; below it, where there are any, missed contacts in % and "
        "false contacts per frame."
    )
    cases = (b for k, axis in enumerate(axes) for b in _case_blocks(rows, families, k, axis))
    return [
        _doubling_table(rows, families, pressed, "Where the error doubles: what is pressed"),
        _doubling_table(
            rows, families, faults, "Where the error doubles: the camera and its light"
        ),
        Group("Error by case, mm", (prose(note), *cases)),
    ]


def _doubling_table(
    rows: Sequence[Row],
    families: Sequence[Sequence[FamilyErrors]],
    axes: Sequence[Axis],
    title: str,
) -> Table:
    body = []
    for row, grades in zip(rows, families, strict=True):
        by_family = {grade.axis.family: grade for grade in grades}
        cells = (doubling_number(by_family[axis.family].doubles) for axis in axes)
        body.append([*identity(row), *cells])
    heads: list[Head] = [*IDENTITY, *(Column(family_head(axis)) for axis in axes)]
    return replace(table(heads, body, title=title), guide=DOUBLING_NOTE)


def family_head(axis: Axis) -> str:
    """Return the name of a family with its unit, such as "grazing, mm"."""
    return f"{axis.family}, {axis.unit}" if axis.unit else axis.family


def doubling_number(pooled: PooledMetric | None) -> Number | None:
    """Return the value at which an error doubles: "0.21" with its interval, or "> 6.5"."""
    if pooled is None:
        return None
    return Number(pooled.value, general, (pooled.low, pooled.high), pooled.censored or "")


def _case_blocks(
    rows: Sequence[Row], families: Sequence[Sequence[FamilyErrors]], k: int, axis: Axis
) -> list[Block]:
    heads: list[Head] = [*IDENTITY, *(Column(f"{case.value:g}") for case in families[0][k].cases)]
    body = [
        [*identity(row), *(_case_number(case) for case in grades[k].cases)]
        for row, grades in zip(rows, families, strict=True)
    ]
    unit = f", {axis.unit}" if axis.unit else ""
    return [Heading(4, f"{axis.family}: {axis.title}{unit}"), table(heads, body)]


def _case_number(case: Case) -> Number | None:
    if case.error is None:
        return None
    below = []
    if case.missed is not None and case.missed.value:
        below.append(f"{number(100 * case.missed.value, 1)} %")
    if case.spurious is not None and case.spurious.value:
        below.append(f"{number(case.spurious.value, 2)} false")
    return Number(case.error.value, fixed(3), below=", ".join(below))


def family_table(row: Row, axes: Sequence[Axis]) -> Table:
    """Return the errors of one row on the easy and the hardest case of every family."""
    heads: list[Head] = [
        "family",
        *map(Column, ("easy", "mm", "hardest", "mm", "missed, %", "worst ratio")),
        "doubles at",
    ]
    title = "Error by family, from the easy case to the hardest"
    return table(heads, [_family_cells(grade) for grade in family_errors(row, axes)], title=title)


def _family_cells(grade: FamilyErrors) -> list[Cell]:
    first, last = grade.cases[0], grade.cases[-1]
    graded = len(grade.cases) > 1
    return [
        family_head(grade.axis),
        f"{first.value:g}" if graded else "",
        _error(first) if graded else "",
        f"{last.value:g}" if graded else "",
        _error(last),
        "" if last.missed is None else Number(100 * last.missed.value, fixed(1)),
        "" if grade.worst is None else Number(grade.worst.value, fixed(1)),
        doubling_number(grade.doubles) if grade.axis.ordered else "",
    ]


def _error(case: Case) -> Number | None:
    return None if case.error is None else Number(case.error.value, fixed(3))


def doubling_table(rows: Sequence[Row], axes: Sequence[Axis]) -> Table:
    """Return the values at which errors double: one row a family, one column a model."""
    families = [family_errors(row, axes) for row in rows]
    body: list[list[Cell]] = []
    for k, axis in enumerate(axes):
        if axis.ordered:
            numbers: list[Cell] = []
            for grades in families:
                doubles = doubling_number(grades[k].doubles)
                if doubles is not None and len(rows) > WITH_INTERVALS:
                    doubles = replace(doubles, interval=None)
                numbers.append(doubles)
            body.append([family_head(axis), f"{axis.easy:g} to {axis.values[-1]:g}", *numbers])
    heads: list[Head] = ["family", "easy to hardest", *(row.label for row in rows)]
    interval = "" if len(rows) > WITH_INTERVALS else ": value [95 % interval]"
    return table(heads, body, title=f"Where the error doubles{interval}")
