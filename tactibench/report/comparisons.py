"""Many runs on the terminal: against each other in pairs, and the cells of a sweep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from string import ascii_uppercase

from rich.console import Console
from rich.text import Text

from tactibench.board import (
    Comparison,
    MetricComparison,
    ReproducedMetric,
    ReproducedRun,
    Verdict,
    left_out,
    names_of,
)
from tactibench.metrics import find_metric
from tactibench.records import StoredRun, measured_on
from tactibench.report import tables
from tactibench.report.run_view import misses_line, partial_line
from tactibench.report.tables import (
    MISSING,
    NAMES,
    PERCENT,
    UNITS,
    Column,
    Head,
    Number,
    Table,
    duration,
    fixed,
    metric_number,
    named,
    number,
    plural,
    print_table,
    table,
)
from tactibench.sweep import AXES, STATES, Cell, CellState

DECIMALS = {"mm": 4, "deg": 3, "share": 2, "per frame": 3}
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
        lines = filter(None, (misses_line(run.record), partial_line(run.record)))
        console.print(Text(f"{sign}  {name}  {'; '.join(lines)}"), soft_wrap=True)
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
    rows = []
    for row in _with_values(comparison):
        alone = "/".join(f"{n:,}" for n in row.alone) if any(row.alone) else ""
        rows.append([*_cells(row, signs), *([alone] if apart else [])])
    return table(heads, rows)


def _with_values(comparison: Comparison) -> list[MetricComparison]:
    return [row for row in comparison.rows if row.difference.value is not None]


def _cells(row: MetricComparison, signs: tuple[str, str]) -> Iterator[tables.Cell]:
    unit, difference = find_metric(row.metric).unit, row.difference
    scale, write = PERCENT if unit == "share" else 1.0, fixed(DECIMALS.get(unit, 4))

    def signed(value: float) -> str:
        return write(value) if value <= 0 else f"+{write(value)}"

    name, group = NAMES.get(row.metric, row.metric), "" if row.group == "all" else row.group
    yield ", ".join(filter(None, (name, group, UNITS.get(unit, unit))))
    for value in (row.first, row.second):
        yield None if value is None else Number(value * scale, write)
    ends = [None if e is None else e * scale for e in (difference.low, difference.high)]
    value = difference.value
    yield None if value is None else Number(value * scale, signed, (ends[0], ends[1]))
    yield _better(row, *signs)
    for p in (row.p, row.p_holm):
        yield MISSING if p is None else f"{p:.4f}"
    yield "/".join(number(100 * share, 2) for share in row.misses or ())
    yield f"{difference.clusters:,}"


def _better(row: MetricComparison, first: str, second: str) -> str:
    """Return the run that is better where interval and permutation test agree that it is; or ""."""
    difference, better = row.difference, find_metric(row.metric).better
    low, high = difference.low, difference.high
    if better == "none" or low is None or high is None or low <= 0 <= high:
        return ""
    if row.p is None or row.p >= SIGNIFICANT:  # with few presses the t interval claims too much
        return ""
    return first if (high < 0) == (better == "lower") else second


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
    empty = {row.metric for pair in comparisons for row in pair.rows} - {
        row.metric for pair in comparisons for row in _with_values(pair)
    }
    if empty:
        names = ", ".join(sorted(NAMES.get(name, name) for name in empty))
        yield f"No press of which both have a value: {names}."
    if others := left_out(runs):
        yield f"No means over presses, not compared: {', '.join(NAMES.get(n, n) for n in others)}."


def print_sweep(console: Console, states: Mapping[Cell, CellState], store: Path) -> None:
    """Print every cell with its state, and the number of cells of each state.

    Args:
        console: Console to print on.
        states: The cells of the sweep.
        store: Folder of the run store.
    """
    axes = [axis for axis in AXES if any(cell.axes[axis] for cell in states)]
    rows = []
    for cell, state in states.items():
        time = "" if state.seconds is None else duration(state.seconds)
        name = "" if state.state == "to do" else state.name
        rows.append((*(cell.axes[axis] or "default" for axis in axes), state.state, time, name))
    heads = [Column(head, right=head in ("seed", "time")) for head in (*axes, "state", "time")]
    print_table(console, table([*heads, "run"], rows))
    for cell, state in states.items():
        if state.why:
            console.print(Text(f"{cell.label}: {state.why}"), soft_wrap=True)
    counts: Counter[str] = Counter(state.state for state in states.values())
    parts = ", ".join(f"{counts[state]} {state}" for state in STATES if counts[state])
    console.print(Text(f"{plural(len(states), 'cell')}: {parts}; store {store}"), soft_wrap=True)


def print_verdict(console: Console, verdict: Verdict) -> None:
    """Print the name and what was computed anew."""
    record = verdict.record
    lines = (
        f"VERIFIED {verdict.path.name}",
        f"  {verdict.subject}",
        f"  {record.protocol.label}, answers {record.identity.predictions_hash[:12]}",
        f"  checked: {verdict.checked}",
        f"  only the submitter's word: {verdict.unknown}",
    )
    for k, line in enumerate(lines):
        console.print(Text(line, style="" if k else "bold"), soft_wrap=True)
    rows = [
        (
            f"  {named(row.metric, row.unit)}",
            row.group,
            metric_number(row, 2 if row.unit == "share" else 4),
            f"{row.clusters:,}",
        )
        for row in verdict.headline()
    ]
    print_table(console, table(("  metric", "group", "value [95 %]", Column("presses")), rows))
    text = "  `tactibench board reproduce` makes the run again, which shows all of it but the times"
    console.print(Text(text, style="dim"), soft_wrap=True)


def print_reproduction(console: Console, run: ReproducedRun) -> None:
    """Print the metrics that decide, beside those of the record, and how many others agree.

    Args:
        console: The console.
        run: A record and the run made again.
    """
    rows = [
        (
            f"  {named(one.stated.metric, one.stated.unit)}",
            one.stated.group,
            *(_value(value, one) for value in (one.stated.value, one.value)),
            " to ".join(_value(end, one) for end in (one.low, one.high)),
            "" if one.within else "NO",
        )
        for one in run.metrics
        if one.decides
    ]
    verb = "REPRODUCED" if run.reproduced else "NOT REPRODUCED"
    console.print(Text(f"{verb} {run.path.name}", style="bold"), soft_wrap=True)
    heads = ("  metric", "group", "record", "reproduced", "tolerance", "within")
    print_table(console, table(heads, rows))
    within = sum(one.within for one in run.metrics)
    frames = "the same test frames" if run.same_frames else "test frames with another hash"
    text = f"  {within:,} of {len(run.metrics):,} metrics within tolerance, on {frames}"
    console.print(Text(text), soft_wrap=True)


def _value(value: float | None, metric: ReproducedMetric) -> str:
    scale = 100.0 if metric.stated.unit == "share" else 1.0
    return "n/a" if value is None else f"{scale * value:.5g}"
