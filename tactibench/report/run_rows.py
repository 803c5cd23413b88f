"""Rows of a run's main tables, and the lines that all views of a run share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from rich.console import Console
from rich.text import Text

from tactibench.metrics import condition
from tactibench.protocols import RunTable
from tactibench.records import Metric, Record
from tactibench.report.labels import is_share
from tactibench.report.numbers import general
from tactibench.report.table import NO_INTERVAL, Cell, Number, Table, metric_number

NO_INTERVAL_NOTE = (
    f"{NO_INTERVAL}: no interval. One press has none, and of few presses the bootstrap of R2 may "
    "give none that holds its value."
)
Key = tuple[str, str]
"""Metric and group."""


def run_label(record: Record) -> str:
    """Return the model with its regime, in the form of the labels of published rows."""
    label = f"{record.model.name} ({record.regime})" if record.regime else record.model.name
    return f"{label}, {record.shots:,} labelled presses" if record.shots else label


def partial_line(record: Record) -> str:
    """Return the warning of a run that was cut short; "" for a complete run."""
    if not record.partial:
        return ""
    causes = ["quick"] if record.limits.quick else []
    if record.limits.limit is not None:
        causes.append(f"limit {record.limits.limit}")
    cause = f" ({', '.join(causes)})" if causes else ""
    return f"PARTIAL{cause}: not for a board"


def print_warning(console: Console, record: Record) -> None:
    """Print a warning where a run was cut short."""
    if line := partial_line(record):
        console.print(Text(line, style="bold red"))


def lacks_interval(shown: Table) -> bool:
    """Return whether a table holds a value from which no interval could be made."""
    cells = (cell for row in shown.rows for cell in row)
    return any(isinstance(cell, Number) and str(cell).endswith(NO_INTERVAL) for cell in cells)


def measured_rows(run_table: RunTable, record: Record) -> tuple[list[list[Cell]], list[Metric]]:
    """Return the rows of a main table, one a group with its counts, and the metrics in them."""
    metrics = {(metric.metric, metric.group): metric for metric in record.metrics}
    groups = run_table.groups or _distances(run_table, metrics)
    decimals = {m: _decimals(run_table, m, metrics, groups) for m in run_table.metrics}
    rows: list[list[Cell]] = []
    shown: list[Metric] = []
    for group in groups:
        cells = {name: metrics.get((name, group)) for name in run_table.metrics}
        present = [metric for metric in cells.values() if metric is not None]
        shown += present
        n = "/".join(f"{n:,}" for n in sorted({metric.n for metric in present}))
        presses = f"{max((metric.clusters for metric in present), default=0):,}"
        values = (metric_cell(metric, decimals[name]) for name, metric in cells.items())
        rows.append([group, *values, n, presses])
    return rows, shown


def metric_cell(metric: Metric | None, decimals: int) -> Number | None:
    """Return the number of a metric, with its interval where that tells something."""
    value = metric_number(metric, decimals)
    if value is not None and _is_perfect(metric, value):
        return replace(value, interval=None)
    # A bound is a tested distance, which is written without further digits: "< 6.5".
    return replace(value, write=general) if value is not None and value.bound else value


def _is_perfect(metric: Metric | None, value: Number) -> bool:
    """Return whether this is R2 of 1.0000 [1.0000, 1.0000], whose interval tells nothing."""
    return metric is not None and metric.metric == "r2" and value.ends == (value.text, value.text)


def _distances(run_table: RunTable, metrics: Mapping[Key, Metric]) -> list[str]:
    distances = {
        group: distance
        for name, group in metrics
        if name in run_table.metrics and (distance := condition(group)) is not None
    }
    return sorted(distances, key=distances.__getitem__)


def _decimals(
    run_table: RunTable, name: str, metrics: Mapping[Key, Metric], groups: Iterable[str]
) -> int:
    """Return the decimals; by distance one less where values reach 1 mm or 10 deg.

    So the tables of two-point discrimination fit 80 columns.
    """
    decimals = run_table.metrics[name]
    if run_table.groups:
        return decimals
    rows = [metrics[name, group] for group in groups if (name, group) in metrics]
    if is_share(name):
        return decimals + any(row.n > 100 and row.value is not None for row in rows)
    tops = (row.value if row.high is None else row.high for row in rows)
    top = max((top for top in tops if top is not None), default=0.0)
    return decimals - (top >= (10.0 if name.endswith("_deg") else 1.0))
