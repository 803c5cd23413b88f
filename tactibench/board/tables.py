"""One section of a board as Markdown tables: errors, then what they cost."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence

from tactibench.board.columns import BENEATH, Block, Column
from tactibench.board.markdown import Head, plain, table
from tactibench.board.numbers import number
from tactibench.board.ranks import Ranks
from tactibench.board.rows import Pooled, Row

IDENTITY = (
    Head("model", right=False),
    Head("encoder", right=False),
    Head("regime", right=False),
    Head("mixing"),
    Head("seeds"),
)
MISSING = "n/a"


def block_lines(block: Block, rows: Sequence[Row], ranks: Ranks | None = None) -> list[str]:
    """Heading, table and notes of a block; nothing where it is optional and empty.

    ranks: of the rows, in a column before the others; None: no such column.
    """
    first = block.columns[0]
    if block.optional and all(row.metric(first.metric, first.group) is None for row in rows):
        return []
    heads = [*IDENTITY] if ranks is None else [Head("rank"), *IDENTITY]
    for column in block.columns:
        heads.append(Head(column.head))
        if column.spread:
            heads.append(Head("sd"))
    body = [[*identity(row), *_cells(row, block.columns)] for row in rows]
    if ranks is not None:
        numbers = (MISSING if rank is None else str(rank) for rank in ranks.by_row)
        body = [[rank, *cells] for rank, cells in zip(numbers, body, strict=True)]
    note = "" if ranks is None else ranks.note
    notes = " ".join(filter(None, (block.note, _presses(block, rows), note)))
    return [f"### {block.title}", "", *table(heads, body), "", *([notes, ""] if notes else [])]


def identity(row: Row) -> list[str]:
    """Model, encoder, regime, mixing, seeds; trivial models in italics."""
    model = plain(row.model)
    return [
        f"*{model}*" if row.trivial else model,
        plain(row.encoder) or "none",
        plain(row.regime),
        row.mixing or "no",
        seeds(len(row.records)),
    ]


def seeds(count: int) -> str:
    """ "3", or "1 seed": one says nothing about the others."""
    return "1 seed" if count == 1 else str(count)


def deviation(values: Sequence[float]) -> float | None:
    """Sample standard deviation over seeds, None for one."""
    return statistics.stdev(values) if len(values) > 1 else None


def spread_cell(sd: float | None, decimals: int) -> str:
    return MISSING if sd is None else number(sd, decimals)


def _cells(row: Row, columns: Iterable[Column]) -> Iterable[str]:
    for column in columns:
        found = row.metric(column.metric, column.group)
        yield _value(column, found) + _beneath(row, column)
        if column.spread:
            sd = None if found is None else found.sd
            scale = 1.0 if found is None else _scale(found)
            yield spread_cell(None if sd is None else sd * scale, column.decimals)


def _value(column: Column, found: Pooled | None) -> str:
    """ "0.0301", with its interval in small letters below; "< 6.5" where it is a limit."""
    if found is None:
        return MISSING
    scale = _scale(found)
    text = number(found.value * scale, column.decimals)
    if found.censored:
        return f"{plain(found.censored)} {text}"
    if not column.interval:
        return text
    ends = (
        "open" if end is None else number(end * scale, column.decimals)
        for end in (found.low, found.high)
    )
    return f"{text}<br><sub>{' – '.join(ends)}</sub>"


def _beneath(row: Row, column: Column) -> str:
    """The share that qualifies an error of one distance."""
    share = BENEATH.get(column.metric)
    if share is None or column.group == "all":
        return ""
    found = row.metric(share, column.group)
    return "" if found is None else f"<br><sub>{number(100 * found.value, 0)} %</sub>"


def _scale(found: Pooled) -> float:
    return 100.0 if found.unit == "share" else 1.0


def _presses(block: Block, rows: Sequence[Row]) -> str:
    """How many presses the first column rests on."""
    first = block.columns[0]
    found = [p for row in rows if (p := row.metric(first.metric, first.group)) is not None]
    if not found:
        return ""
    low = min(pooled.clusters[0] for pooled in found)
    high = max(pooled.clusters[1] for pooled in found)
    return f"{low:,} presses." if low == high else f"{low:,} to {high:,} presses."
