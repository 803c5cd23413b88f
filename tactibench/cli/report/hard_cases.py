"""Hard cases in a terminal: a line a family, and what failed altogether."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.text import Text

from tactibench.board.hard_cases import DECIMALS, Graded, graded
from tactibench.board.numbers import number
from tactibench.board.rows import Pooled, Row
from tactibench.cli.report.cells import Cells, aligned, print_grid
from tactibench.cli.report.words import NAMES
from tactibench.protocols.families import Axis
from tactibench.records.record import Record

HEADS = ("family", "easy", "mm", "hardest", "mm", "missed, %", "worst ratio", "doubles at")
RIGHT = frozenset({"easy", "mm", "hardest", "missed, %", "worst ratio"})


def print_hard_cases(console: Console, record: Record, axes: Sequence[Axis]) -> None:
    """Error of the easy and of the hardest case of every family, and where it doubles."""
    row = Row((record,))
    families = graded(row, axes)
    console.print()
    console.print(Text("Error by family, from the easy case to the hardest", style="bold"))
    places = aligned([doubling(one.doubles) for one in families])
    lines = (_line(one, place) for one, place in zip(families, places, strict=True))
    print_grid(console, HEADS, lines, right=RIGHT)
    console.print()
    for line in _totals(row, record):
        console.print(Text(line))


def doubling(found: Pooled | None) -> str:
    """ "0.21 [0.18, 0.27]", "> 6.5", "n/a"."""
    if found is None:
        return "n/a"
    text = f"{found.value:.3g}"
    if found.censored:
        return f"{found.censored} {text}"
    low, high = ("open" if end is None else f"{end:.3g}" for end in (found.low, found.high))
    return f"{text} [{low}, {high}]"


def _line(one: Graded, place: str) -> Cells:
    unit = f", {one.axis.unit}" if one.axis.unit else ""
    first, last = one.cases[0], one.cases[-1]
    easy = ("", "") if len(one.cases) == 1 else (f"{first.value:g}", _mm(first.error))
    missed = "" if last.missed is None else number(100 * last.missed.value, 1)
    worst = "" if one.worst is None else number(one.worst.value, 1)
    hardest = (f"{last.value:g}" if len(one.cases) > 1 else "", _mm(last.error))
    return (
        f"{one.axis.family}{unit}",
        *easy,
        *hardest,
        missed,
        worst,
        place if one.axis.ordered else "",
    )


def _mm(found: Pooled | None) -> str:
    return "n/a" if found is None else number(found.value, DECIMALS)


def _totals(row: Row, record: Record) -> Iterable[str]:
    found = row.metric("false_per_1000", "all")
    if found is not None:
        low, high = ("open" if end is None else number(end, 1) for end in (found.low, found.high))
        yield f"false contacts per 1,000 empty frames: {number(found.value, 1)} [{low}, {high}]"
    for name in ("not_finite", "raised"):
        count = row.metric(name, "all")
        if count is not None:
            yield f"{NAMES[name]}: {count.value:,.0f}"
    failures = record.data.failures
    for one in () if failures is None else failures.causes:
        yield f"  {one.frames:,} x {one.cause} (first: {one.first})"
