"""Published rows, apart from measured ones, with where they come from and what they were."""

from __future__ import annotations

from collections.abc import Sequence

from tactibench.board.markdown import Head, plain, table
from tactibench.board.published import PublishedRow, PublishedTable, rows_for

GROUPS = {
    "r2": "R2",
    "mae_mm": "MAE, mm",
    "rmse_mm": "RMSE, mm",
    "distance_mae_mm": "distance error, mm",
    "position_mean_mm": "position, mm",
    "depth_mae_mm": "depth, mm",
    "tilt_mae_deg": "tilt, deg",
    "coverage": "answered, %",
}


def published_lines(protocol: str, tables: Sequence[PublishedTable]) -> list[str]:
    """One subsection a paper; nothing where no paper has a row of this protocol."""
    lines: list[str] = []
    for paper in tables:
        rows = rows_for(protocol, paper)
        if rows:
            lines += _paper(paper, rows)
    if not lines:
        return []
    return ["## Published", "", "Numbers as printed, measured elsewhere by others.", "", *lines]


def _paper(paper: PublishedTable, rows: Sequence[PublishedRow]) -> list[str]:
    """Columns are the metrics and groups that any of its rows has."""
    columns = list(
        dict.fromkeys((m, g) for row in rows for m, groups in row.metrics.items() for g in groups)
    )
    digits = {metric: _digits(metric, rows) for metric, _ in columns}
    rates = any(row.speed for row in rows)
    heads = [
        Head("model", right=False),
        Head("regime", right=False),
        *(Head(_head(metric, group)) for metric, group in columns),
        Head("n"),
        *([Head("speed", right=False)] if rates else []),
        Head("comparable", right=False),
        Head("source", right=False),
    ]
    body = [
        [
            plain(row.model),
            row.regime or "n/a",
            *(_value(row, m, g, digits[m]) for m, g in columns),
            f"{row.n:,} {plain(row.unit)}" if row.n else "n/a",
            *([_speed(row)] if rates else []),
            row.comparable,
            plain(row.source),
        ]
        for row in rows
    ]
    who = f"{paper.authors}, *{plain(paper.title)}*, {paper.year}"
    reasons = list(dict.fromkeys(row.note for row in rows))
    return [
        f"### {plain(paper.name)}",
        "",
        f"{who}. Measured on: {plain(paper.measured_on)}.",
        "",
        *table(heads, body),
        "",
        *(f"- {plain(text)}" for text in (*reasons, *paper.notes)),
        "",
    ]


def _head(metric: str, group: str) -> str:
    name = GROUPS.get(metric, plain(metric))
    return name if group == "all" else f"{name}, {plain(group)}"


def _value(row: PublishedRow, metric: str, group: str, digits: int) -> str:
    value = row.value(metric, group)
    if value is None:
        return "n/a"
    digits = min(digits, row.decimals)
    return f"{100 * value:.{digits - 2}f}" if metric == "coverage" else f"{value:.{digits}f}"


def _digits(metric: str, rows: Sequence[PublishedRow]) -> int:
    """Decimals that a paper prints of a metric: the most that any of its values has."""
    values = [value for row in rows for value in row.metrics.get(metric, {}).values()]
    return max((len(str(value).partition(".")[2]) for value in values), default=0)


def _speed(row: PublishedRow) -> str:
    if row.speed is None:
        return "n/a"
    return plain(f"{row.speed.phase} {row.speed.per_s:g}/s, {row.speed.hardware}")
