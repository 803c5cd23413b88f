"""Hard cases on a board: where every model's error doubles, and its error case by case."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tactibench.board.markdown import Head, plain, table
from tactibench.board.numbers import number
from tactibench.board.rows import Pooled, Row
from tactibench.board.tables import IDENTITY, MISSING, identity
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


def hard_case_lines(rows: Sequence[Row], axes: Sequence[Axis]) -> list[str]:
    """Tables of doubling points, pressed families and families of faults apart, and a table of
    errors for every family; nothing for a protocol without families."""
    if not axes:
        return []
    found = [graded(row, axes) for row in rows]
    own = [axis for axis in axes if axis.ordered and axis.reference.startswith(f"{axis.family}:")]
    faults = [axis for axis in axes if axis.ordered and axis not in own]
    return [
        *_doubling(rows, found, own, "Where the error doubles: what is pressed"),
        *_doubling(rows, found, faults, "Where the error doubles: the camera and its light"),
        "### Error by case, mm",
        "",
        f"`{ERROR}`, the easy case first; below it, missed contacts in %, and false contacts per "
        "frame where there are any.",
        "",
        *(line for k, axis in enumerate(axes) for line in _by_case(rows, found, k, axis)),
    ]


def _doubling(
    rows: Sequence[Row], found: Sequence[Sequence[Graded]], axes: Sequence[Axis], title: str
) -> list[str]:
    heads = [*IDENTITY, *(Head(head(axis)) for axis in axes)]
    body = []
    for row, families in zip(rows, found, strict=True):
        by_name = {one.axis.family: one for one in families}
        cells = (doubling_cell(by_name[axis.family].doubles) for axis in axes)
        body.append([*identity(row), *cells])
    note = (
        "Value at which the error is twice that of the easy case, linear between the cases; below "
        'it, where the ends of the ratios\' 95 % intervals reach two. "<", ">": not doubled at '
        "the hardest case, which stands behind it. n/a: the easy case costs more than half the "
        "gate already. A model with a small error doubles it early: "
        "the error itself stands below."
    )
    return [f"### {title}", "", *table(heads, body), "", note, ""]


def head(axis: Axis) -> str:
    """ "grazing, mm"."""
    return plain(f"{axis.family}, {axis.unit}" if axis.unit else axis.family)


def doubling_cell(found: Pooled | None) -> str:
    """ "0.21", with its interval below; "> 6.5" where the error does not double."""
    if found is None:
        return MISSING
    text = f"{found.value:.3g}"
    if found.censored:
        return f"{plain(found.censored)} {text}"
    ends = ("open" if end is None else f"{end:.3g}" for end in (found.low, found.high))
    return f"{text}<br><sub>{' – '.join(ends)}</sub>"


def _by_case(
    rows: Sequence[Row], found: Sequence[Sequence[Graded]], k: int, axis: Axis
) -> list[str]:
    values = [case.value for case in found[0][k].cases]
    heads = [*IDENTITY, *(Head(f"{value:g}") for value in values)]
    body = [
        [*identity(row), *(_error_cell(case) for case in families[k].cases)]
        for row, families in zip(rows, found, strict=True)
    ]
    unit = f", {axis.unit}" if axis.unit else ""
    return [f"#### {axis.family}: {plain(axis.title)}{plain(unit)}", "", *table(heads, body), ""]


def _error_cell(case: Case) -> str:
    if case.error is None:
        return MISSING
    parts = []
    if case.missed is not None:
        parts.append(f"{number(100 * case.missed.value, 1)} %")
    if case.spurious is not None and case.spurious.value:
        parts.append(f"{number(case.spurious.value, 2)} false")
    below = f"<br><sub>{', '.join(parts)}</sub>" if parts else ""
    return f"{number(case.error.value, DECIMALS)}{below}"
