"""The tables of ``tactibench compare``: one for each pair of runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from string import ascii_uppercase

from rich.console import Console
from rich.text import Text

from tactibench.board import Comparison, MetricComparison, measured_on, names_of
from tactibench.board.compare import left_out
from tactibench.metrics import find_metric
from tactibench.records import Record, StoredRun
from tactibench.report.labels import NAMES, UNITS
from tactibench.report.numbers import Format, fixed, number
from tactibench.report.table import MISSING, PERCENT, Cell, Column, Head, Number, Table, table
from tactibench.report.writers.terminal import print_table

DECIMALS = {"mm": 4, "deg": 3, "share": 2, "per frame": 3}
MISSES = (
    ("missed", "missed", PERCENT, 2, " %"),
    ("spurious", "spurious", 1.0, 3, " / frame"),
    ("coverage", "answered", PERCENT, 2, " %"),
)
"""Metric, word, scale, decimals and unit of the numbers that always stand beside an error."""


SIGNIFICANT = 0.05
"""A run is called better where p is below this."""


def print_comparisons(
    console: Console, runs: Sequence[StoredRun], comparisons: Sequence[Comparison]
) -> None:
    """Print the names of the runs, a table for each pair, and how to read it.

    Args:
        console: Console to print on.
        runs: Runs that were compared.
        comparisons: Comparison of each pair.
    """
    first = runs[0].record
    signs = [ascii_uppercase[k] if k < 26 else f"R{k}" for k in range(len(runs))]
    console.print(Text(f"{first.protocol.id}  {first.protocol.title}", style="bold"))
    console.print(Text(f"{measured_on(first)}, {first.data.test:,} test frames"))
    for sign, name, run in zip(signs, names_of(runs), runs, strict=True):
        console.print(Text(f"{sign}  {name}  {_misses(run.record)}"), soft_wrap=True)
        console.print(Text(f"   {run.record.name}", style="dim"), soft_wrap=True)
    for comparison in comparisons:
        pair = signs[comparison.first], signs[comparison.second]
        console.print()
        several = len(comparisons) > 1
        print_table(console, comparison_table(comparison, pair, several=several))
    console.print()
    for note in _notes(runs, comparisons):
        console.print(Text(note, style="dim"))


def comparison_table(
    comparison: Comparison, signs: tuple[str, str], *, several: bool = False
) -> Table:
    """Return the table of two runs, with one row for every metric.

    Args:
        comparison: Comparison of the runs.
        signs: Letters that stand for the first and the second run.
        several: Whether there are several tables, so that each has to name its runs.
    """
    first, second = signs
    misses = "answered" if any(row.metric == "coverage" for row in comparison.rows) else "missed"
    apart = any(any(row.alone) for row in comparison.rows)
    heads: list[Head] = [
        f"{first} - {second}" if several else "metric",
        Column(first),
        Column(second),
        f"{first} - {second} [95 %]",
        "better",
        *map(Column, ("p", "p Holm", f"{misses} %", "presses")),
        *(["one only"] if apart else []),
    ]
    rows = [[*_cells(row, signs), *([_alone(row)] if apart else [])] for row in comparison.rows]
    return table(heads, rows)


def _cells(row: MetricComparison, signs: tuple[str, str]) -> list[Cell]:
    scale, write = _format(row)
    values = (None if v is None else Number(v * scale, write) for v in (row.first, row.second))
    shares = () if row.misses is None else (number(100 * share, 2) for share in row.misses)
    return [
        _name(row),
        *values,
        _difference(row),
        _better(row, *signs),
        *(MISSING if p is None else f"{p:.4f}" for p in (row.p, row.p_holm)),
        "/".join(shares),
        f"{row.difference.clusters:,}",
    ]


def _alone(row: MetricComparison) -> str:
    return "/".join(f"{n:,}" for n in row.alone) if any(row.alone) else ""


def _name(row: MetricComparison) -> str:
    unit = find_metric(row.metric).unit
    group = "" if row.group == "all" else row.group
    name = NAMES.get(row.metric, row.metric)
    return ", ".join(filter(None, (name, group, UNITS.get(unit, unit))))


def _difference(row: MetricComparison) -> Number | None:
    scale, write = _format(row)
    difference = row.difference
    if difference.value is None:
        return None

    def signed(value: float) -> str:
        return write(value) if value <= 0 else f"+{write(value)}"

    low, high = (None if e is None else e * scale for e in (difference.low, difference.high))
    return Number(difference.value * scale, signed, (low, high))


def _format(row: MetricComparison) -> tuple[float, Format]:
    unit = find_metric(row.metric).unit
    return PERCENT if unit == "share" else 1.0, fixed(DECIMALS.get(unit, 4))


def _better(row: MetricComparison, first: str, second: str) -> str:
    """Return the run that is better where interval and permutation test agree that it is; or ""."""
    difference, better = row.difference, find_metric(row.metric).better
    low, high = difference.low, difference.high
    if better == "none" or low is None or high is None or low <= 0 <= high:
        return ""
    if row.p is None or row.p >= SIGNIFICANT:  # with few presses the t interval claims too much
        return ""
    return first if (high < 0) == (better == "lower") else second


def _misses(record: Record) -> str:
    """Return the misses of a record, such as "missed 0.17 %, spurious 0.002 / frame"."""
    parts = []
    for metric, word, scale, decimals, unit in MISSES:
        value = record.value(metric, "all")
        if value is not None:
            parts.append(f"{word} {number(value * scale, decimals)}{unit}")
    return ", ".join(parts) + ("; PARTIAL RUN" if record.partial else "")


def _notes(runs: Sequence[StoredRun], comparisons: Sequence[Comparison]) -> Iterator[str]:
    rows = [row for comparison in comparisons for row in comparison.rows]
    count = sum(row.p is not None for row in rows)
    yield (
        "Means over the presses of which both have a value, frames of one press averaged first; so "
        "they may differ from the figures of a run alone."
    )
    yield (
        "Interval: paired t over presses. better: the interval does not hold 0, and p < "
        f"{SIGNIFICANT:g}. p: two-sided sign-flip permutation test of whole presses; p Holm: "
        f"adjusted for all {count} of this output."
    )
    if any(any(row.alone) for row in rows):
        yield (
            "one only: presses of which the first/the second alone has a value; they are "
            "in neither mean, so read the misses beside the error."
        )
    if others := left_out(runs):
        yield f"No means over presses, not compared: {', '.join(others)}."
