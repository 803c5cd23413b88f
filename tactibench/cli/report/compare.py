"""The tables of ``tactibench compare``: one for every two runs."""

from __future__ import annotations

from collections.abc import Sequence
from string import ascii_uppercase

from rich.console import Console
from rich.text import Text

from tactibench.board.comparison import Compared, Comparison, left_out, names_of
from tactibench.board.labels import measured_on
from tactibench.board.numbers import number
from tactibench.cli.report.cells import Cells, aligned, print_grid
from tactibench.cli.report.words import NAMES
from tactibench.metrics.registry import find_metric
from tactibench.records.store import StoredRun

ABSENT = "n/a"
DECIMALS = {"mm": 4, "deg": 3, "share": 2, "per frame": 3}


def print_comparisons(
    console: Console, runs: Sequence[StoredRun], found: Sequence[Comparison]
) -> None:
    """Print who is compared, a table for every two, and how to read it."""
    first = runs[0].record
    signs = [ascii_uppercase[k] if k < 26 else f"R{k}" for k in range(len(runs))]
    console.print(Text(f"{first.protocol.id}  {first.protocol.title}", style="bold"))
    console.print(Text(f"{measured_on(first)}, {first.data.test:,} test frames"))
    for sign, name, run in zip(signs, names_of(runs), runs, strict=True):
        console.print(Text(f"{sign}  {name}  {_misses(run)}"), soft_wrap=True)
        console.print(Text(f"   {run.record.name}", style="dim"), soft_wrap=True)
    for one in found:
        console.print()
        _print(console, one, signs[one.first], signs[one.second], several=len(found) > 1)
    console.print()
    for note in _notes(runs, found):
        console.print(Text(note, style="dim"))


def _misses(run: StoredRun) -> str:
    """ "missed 0.17 %, spurious 0.002 / frame" of the whole record."""
    known = {row.metric: row.value for row in run.record.metrics if row.group == "all"}
    parts = [
        f"{words} {number(value * scale, decimals)}{unit}"
        for name, words, scale, decimals, unit in (
            ("missed", "missed", 100, 2, " %"),
            ("spurious", "spurious", 1, 3, " / frame"),
            ("coverage", "answered", 100, 2, " %"),
        )
        if (value := known.get(name)) is not None
    ]
    partial = "; PARTIAL RUN" if run.record.partial else ""
    return ", ".join(parts) + partial


def _print(console: Console, one: Comparison, first: str, second: str, *, several: bool) -> None:
    differences = aligned([_difference(row) for row in one.rows])
    rows: list[Cells] = []
    for row, difference in zip(one.rows, differences, strict=True):
        misses = ABSENT if row.misses is None else "/".join(number(100 * m, 2) for m in row.misses)
        rows.append(
            (
                _name(row),
                _value(row, row.first),
                _value(row, row.second),
                difference,
                _verdict(row, first, second),
                _p(row.p),
                _p(row.p_holm),
                "" if row.misses is None else misses,
                f"{row.difference.clusters:,}",
                "/".join(f"{n:,}" for n in row.alone) if any(row.alone) else "",
            )
        )
    share = "answered" if any(row.metric == "coverage" for row in one.rows) else "missed"
    heads = [
        f"{first} - {second}" if several else "metric",
        first,
        second,
        f"{first} - {second} [95 %]",
        "better",
        "p",
        "p Holm",
        f"{share} %",
        "presses",
        "one only",
    ]
    drop = not any(any(row.alone) for row in one.rows)
    if drop:
        heads, rows = heads[:-1], [row[:-1] for row in rows]
    right = frozenset({first, second, "p", "p Holm", "presses", heads[7]})
    print_grid(console, heads, rows, right=right)


def _name(row: Compared) -> str:
    spec = find_metric(row.metric)
    name = NAMES.get(row.metric, row.metric)
    unit = "%" if spec.unit == "share" else spec.unit
    if unit == "per frame":  # the name says so
        unit = ""
    of = "" if row.group == "all" else f", {row.group}"
    return f"{name}{of}{f', {unit}' if unit else ''}"


def _value(row: Compared, value: float | None) -> str:
    if value is None:
        return ABSENT
    scale, decimals = _format(row)
    return number(value * scale, decimals)


def _difference(row: Compared) -> str:
    d = row.difference
    if d.value is None:
        return ABSENT
    scale, decimals = _format(row)
    text = _signed(d.value * scale, decimals)
    if d.low is None or d.high is None:
        return f"{text} [n/a]"
    return f"{text} [{_signed(d.low * scale, decimals)}, {_signed(d.high * scale, decimals)}]"


def _signed(value: float, decimals: int) -> str:
    text = number(value, decimals)
    return text if value <= 0 else f"+{text}"


def _format(row: Compared) -> tuple[float, int]:
    unit = find_metric(row.metric).unit
    return 100.0 if unit == "share" else 1.0, DECIMALS.get(unit, 4)


def _verdict(row: Compared, first: str, second: str) -> str:
    """Who is better, where the interval does not hold 0."""
    d, better = row.difference, find_metric(row.metric).better
    if better == "none" or d.low is None or d.high is None or d.low <= 0 <= d.high:
        return ""
    return first if (d.high < 0) == (better == "lower") else second


def _p(p: float | None) -> str:
    return ABSENT if p is None else f"{p:.4f}"


def _notes(runs: Sequence[StoredRun], found: Sequence[Comparison]) -> list[str]:
    count = sum(row.p is not None for one in found for row in one.rows)
    notes = [
        "Means over the presses of which both have a value, frames of one press averaged first; so "
        "they may differ from the figures of a run alone.",
        "Interval: paired t over presses. better: the interval does not hold 0. p: two-sided "
        f"sign-flip permutation test of whole presses; p Holm: adjusted for all {count} of this "
        "output.",
    ]
    if any(any(row.alone) for one in found for row in one.rows):
        notes.append(
            "one only: presses of which the first/the second alone has a value; they are "
            "in neither mean, so read the misses beside the error."
        )
    if others := left_out(runs):
        notes.append(f"No means over presses, not compared: {', '.join(others)}.")
    return notes
