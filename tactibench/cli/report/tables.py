"""The main tables of a protocol in headed sections, and the list of everything else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.text import Text

from tactibench.board.labels import measured_on
from tactibench.board.numbers import number
from tactibench.board.published import PublishedRow, PublishedTable, rows_for
from tactibench.cli.report.cells import Cells, aligned, estimate, print_grid, span
from tactibench.cli.report.origin import (
    label_of,
    partial_line,
    published_head,
    published_label,
)
from tactibench.cli.report.words import HEADS, NAMES, SHARES, Block
from tactibench.records.record import Metric, Record

COUNTS = ("n", "presses")
TOTALS = frozenset({"false_per_1000", "not_finite", "raised"})
"""Of hard cases; they stand in sentences below the families."""
NARROWEST = 80
"""Columns that tables are made for; a narrower terminal breaks their lines."""


@dataclass(frozen=True)
class Section:
    """Rows of one origin. counts: n and presses, for a line where their columns do not fit."""

    head: str
    label: str
    rows: list[Cells]
    counts: tuple[str, str] = ("", "")


def print_block(
    console: Console,
    block: Block,
    record: Record,
    published: Sequence[PublishedTable],
    others: Sequence[Record],
) -> None:
    """Print a main table: this run, other runs, published rows, each under its origin."""
    sections = [_measured(block, record)]
    if block.compared:
        sections += [_measured(block, other, f"\n  stored as {other.name}") for other in others]
        sections += [
            _printed(block, table, row)
            for table in published
            for row in rows_for(record.protocol.id, table)
        ]
    sections = _line_up([section for section in sections if section.rows])
    heads = ["", *(HEADS[metric] for metric in block.metrics), *COUNTS]
    heads, widths, gap = _fit(heads, sections, max(console.width, NARROWEST))
    console.print()
    console.print(Text(f"{block.title}: value [95 % interval]", style="bold"))
    last = ""
    for k, section in enumerate(sections):
        if section.head != last:
            style = "magenta" if section.head.startswith("published") else "cyan"
            console.print(Text(section.head, style=style))
        unseen = [
            f"{name} {count}"
            for name, count in zip(COUNTS, section.counts, strict=True)
            if count and name not in heads
        ]
        if label := section.label or ", ".join(unseen):
            console.print(Text(label, style="italic"))
        rows = (row[: len(heads)] for row in section.rows)
        print_grid(
            console, heads, rows, right=frozenset(COUNTS), widths=widths, gap=gap, show_heads=k == 0
        )
        last = section.head


def print_others(console: Console, record: Record, blocks: Sequence[Block]) -> None:
    """List every metric that no main table has shown, with its counts."""
    rows = _rest(record, blocks)
    if not rows:
        return
    grouped = any(row.group != "all" for row in rows)
    heads = ["Also measured", *(["of"] if grouped else []), "value [95 % interval]", *COUNTS]
    values = aligned([estimate(r, {"share": 1, "deg": 2, "": 2}.get(r.unit, 3)) for r in rows])
    cells: list[Cells] = []
    last = None
    for row, value in zip(rows, values, strict=True):
        unit = {"share": ", %", "mm": ", mm", "deg": ", deg"}.get(row.unit, "")
        metric = row.metric
        name = "" if metric == last else NAMES.get(metric, metric) + unit
        group = (row.group,) if grouped else ()
        cells.append((name, *group, value, f"{row.n:,}", f"{row.clusters:,}"))
        last = metric
    console.print()
    print_grid(console, heads, cells, right=frozenset(COUNTS))


def _measured(block: Block, run: Record, stored: str = "") -> Section:
    found = {(row.metric, row.group): row for row in run.metrics}
    groups = block.groups or sorted(
        {group for metric, group in found if metric in block.metrics and group != "all"}, key=float
    )
    decimals = {m: _decimals(block, m, [found.get((m, g)) for g in groups]) for m in block.metrics}
    rows, used = [], []
    for group in groups:
        here = {metric: found.get((metric, group)) for metric in block.metrics}
        known = [row for row in here.values() if row is not None]
        used += known
        n = "/".join(f"{n:,}" for n in sorted({row.n for row in known}))
        presses = max((row.clusters for row in known), default=0)
        cells = (estimate(row, decimals[metric]) for metric, row in here.items())
        rows.append((group, *cells, n, f"{presses:,}"))
    counts = (span(row.n for row in used), span(row.clusters for row in used))
    warning = partial_line(run) if stored else None
    head = f"measured here: {label_of(run)}, {measured_on(run)}{stored}"
    return Section(f"{head}; {warning}" if warning else head, "", rows, counts)


def _printed(block: Block, table: PublishedTable, row: PublishedRow) -> Section:
    rows = []
    for group in block.groups:
        values = {metric: row.value(metric, group) for metric in block.metrics}
        if any(value is not None for value in values.values()):
            cells = (_as_printed(m, v, row.decimals, block) for m, v in values.items())
            rows.append((group, *cells, f"{row.n:,}" if row.n else "n/a", ""))
    return Section(published_head(table), published_label(row), rows)


def _as_printed(metric: str, value: float | None, decimals: int, block: Block) -> str:
    """No more digits than the paper prints, nor than the column has."""
    if value is None:
        return "n/a"
    if metric in SHARES:
        return number(100 * value, min(max(decimals - 2, 0), block.metrics[metric]))
    return number(value, min(decimals, block.metrics[metric]))


def _decimals(block: Block, metric: str, rows: Sequence[Metric | None]) -> int:
    """In a table by distance one decimal less where values reach 1 mm or 10 deg."""
    decimals = block.metrics[metric]
    if block.groups:
        return decimals
    known = [(row, row.value) for row in rows if row is not None and row.value is not None]
    if metric in SHARES:
        return decimals + any(row.n > 100 for row, _ in known)
    top = max((value if row.high is None else row.high for row, value in known), default=0.0)
    return decimals - (top >= (10.0 if metric.endswith("_deg") else 1.0))


def _line_up(sections: Sequence[Section]) -> list[Section]:
    """Align each column of values over all sections."""
    every = [row for section in sections for row in section.rows]
    columns = [list(column) for column in zip(*every, strict=True)]
    for k in range(1, len(columns) - len(COUNTS)):
        columns[k] = aligned(columns[k])
    rows = iter(list(zip(*columns, strict=True)))
    return [Section(s.head, s.label, [next(rows) for _ in s.rows], s.counts) for s in sections]


def _fit(
    heads: list[str], sections: Sequence[Section], width: int
) -> tuple[list[str], list[int], int]:
    """The most columns that fit, and the gap between them: presses go first, then n."""
    rows = [row for section in sections for row in section.rows]
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    for count in (len(heads), len(heads) - 1, len(heads) - 2):
        for gap in (2, 1):
            if sum(widths[:count]) + gap * (count - 1) <= width:
                return heads[:count], widths[:count], gap
    return heads[:-2], widths[:-2], 1


def _rest(record: Record, blocks: Sequence[Block]) -> list[Metric]:
    """Rows of the record that no main table shows; of hard cases those of all cases together."""
    shown = {(metric, group) for b in blocks for metric in b.metrics for group in b.groups}
    hard = any(row.metric == "error_ratio" for row in record.metrics)
    by_distance = {metric for b in blocks if not b.groups for metric in b.metrics}
    return [
        row
        for row in record.metrics
        if (row.metric, row.group) not in shown
        and (row.metric not in by_distance or row.group == "all")
        and (not hard or (row.group == "all" and row.metric not in TOTALS))
    ]
