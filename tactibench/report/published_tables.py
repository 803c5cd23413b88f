"""Tables of published results, beside the rows of a board."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from tactibench.protocols import PublishedRow, PublishedTable, rows_for
from tactibench.report.document import Block, Bullets, Heading, Paragraph, Prose, prose
from tactibench.report.labels import HEADS
from tactibench.report.table import Column, Head, Number, Text, table

PUBLISHED_HEADS = HEADS | {"coverage": "answered, %", "distance_mae_mm": "distance error, mm"}


def published_blocks(protocol: str, papers: Iterable[PublishedTable]) -> list[Block]:
    """Return the published rows of a protocol, one table a paper, with their sources."""
    blocks: list[Block] = []
    for paper in papers:
        if rows := rows_for(protocol, paper):
            blocks += _paper_blocks(paper, rows)
    if not blocks:
        return []
    return [
        Heading(2, "Published"),
        prose("Numbers as printed, measured elsewhere by others."),
        *blocks,
    ]


def _paper_blocks(paper: PublishedTable, rows: Sequence[PublishedRow]) -> list[Block]:
    """Return the table of a paper with its source and notes.

    Its columns are the metrics and groups that any of its rows has.
    """
    metrics = list(
        dict.fromkeys((m, g) for row in rows for m, groups in row.metrics.items() for g in groups)
    )
    digits = {metric: _printed_decimals(metric, rows) for metric, _ in metrics}
    rated = any(row.speed for row in rows)
    heads: list[Head] = [
        Column("model", right=False, who=True),
        "regime",
        *(Column(_published_head(metric, group)) for metric, group in metrics),
        Column("n"),
        *(["speed"] if rated else []),
        "comparable",
        "source",
    ]
    body = [
        [
            row.model,
            row.regime,
            *(_printed_number(row, m, g, digits[m]) for m, g in metrics),
            f"{row.n:,} {row.unit}" if row.n else None,
            *([_printed_speed(row)] if rated else []),
            row.comparable,
            row.source,
        ]
        for row in rows
    ]
    who = (paper.authors, Prose(", "), Text(paper.title, "italic"))
    where = (Prose(f", {paper.year}. Measured on: "), paper.measured_on)
    reasons = dict.fromkeys(row.note for row in rows)
    return [
        Heading(3, paper.name),
        Paragraph((*who, *where, Prose("."))),
        table(heads, body),
        Bullets(tuple((text,) for text in (*reasons, *paper.notes))),
    ]


def _published_head(metric: str, group: str) -> str:
    name = PUBLISHED_HEADS.get(metric, metric)
    return name if group == "all" else f"{name}, {group}"


def _printed_number(row: PublishedRow, metric: str, group: str, digits: int) -> Number | None:
    value = row.value(metric, group)
    if value is None:
        return None
    digits = min(digits, row.decimals)
    if metric == "coverage":
        return Number(100 * value, f"{{:.{digits - 2}f}}".format)
    return Number(value, f"{{:.{digits}f}}".format)


def _printed_decimals(metric: str, rows: Sequence[PublishedRow]) -> int:
    """Return the decimals that a paper prints of a metric: the most that any value has."""
    values = [value for row in rows for value in row.metrics.get(metric, {}).values()]
    return max((len(str(value).partition(".")[2]) for value in values), default=0)


def _printed_speed(row: PublishedRow) -> str | None:
    if row.speed is None:
        return None
    return f"{row.speed.phase} {row.speed.per_s:g}/s, {row.speed.hardware}"
