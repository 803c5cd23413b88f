"""Tables as narrow as a page needs them, without empty columns and rows.

A Markdown board shows in every row what was not measured. A page leaves out columns and rows that
hold no value, and writes encoder, regime, mixing and seeds below the name of the model. Words that
are the same in all rows stand once, below the table.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from tactibench.report.document import Block, Group
from tactibench.report.numbers import plural
from tactibench.report.table import Cell, Column, Number, Table, Text


def compact_blocks(blocks: Iterable[Block]) -> list[Block]:
    """Return the blocks with compact tables, and without tables that hold no value."""
    result: list[Block] = []
    for block in blocks:
        if isinstance(block, Group):
            result.append(replace(block, blocks=tuple(compact_blocks(block.blocks))))
        elif not isinstance(block, Table):
            result.append(block)
        elif (table := compact(block)) is not None:
            result.append(table)
    return result


def compact(table: Table) -> Table | None:
    """Return the table without columns and rows that hold no value; None where nothing is left.

    Columns of detail are left out where the name of the row says the same; a standard deviation
    stands below its value.
    """
    named = [any(_says_details(row, table.columns)) for row in table.rows]
    columns, rows = _without_spread(table.columns, table.rows)
    facts = [k for k, column in enumerate(columns) if not (column.who or column.detail)]
    full = [k for k, row in enumerate(rows) if any(_holds(row[f]) for f in facts)]
    used = {f for f in facts if any(_holds(rows[k][f]) for k in full)}
    if not used:
        return None
    left_out = len(rows) - len(full)
    notes = [f"{plural(left_out, 'row')} without a value not shown."] if left_out else []
    same = {f: text for f in used if (text := _same_words([rows[k][f] for k in full]))}
    if same:
        listed = "; ".join(f"{columns[f].head}: {same[f]}" for f in sorted(same))
        notes.append(f"In all rows: {listed}.")
    shown = [
        k
        for k, column in enumerate(columns)
        if (k in used and k not in same) or column.who or (column.detail and not all(named))
    ]
    return replace(
        table,
        columns=tuple(columns[k] for k in shown),
        rows=tuple(tuple(rows[k][c] for c in shown) for k in full),
        note=" ".join(filter(None, (table.note, *notes))),
        captions={},
        anchors=tuple(table.anchors[k] for k in full) if table.anchors else (),
    )


def named_briefly(blocks: Iterable[Block]) -> list[Block]:
    """Return the blocks with details of models only where a table needs them to tell rows apart.

    A filter still finds the details. The first table of a section shows them all.
    """
    result: list[Block] = []
    for block in blocks:
        if isinstance(block, Group):
            result.append(replace(block, blocks=tuple(named_briefly(block.blocks))))
        else:
            result.append(_named_briefly(block) if isinstance(block, Table) else block)
    return result


def _named_briefly(table: Table) -> Table:
    who = next((k for k, column in enumerate(table.columns) if column.who), None)
    if who is None:
        return table
    names = [row[who] for row in table.rows]
    if len({name.text for name in names if isinstance(name, Text)}) < len(names):
        return table
    rows = (
        tuple(
            replace(cell, brief=True) if k == who and isinstance(cell, Text) else cell
            for k, cell in enumerate(row)
        )
        for row in table.rows
    )
    return replace(table, rows=tuple(rows))


def _same_words(cells: list[Cell]) -> str:
    """Return the words that all rows share; "" for numbers, and where rows differ."""
    if len(cells) < 2 or any(cell != cells[0] for cell in cells):
        return ""
    first = cells[0]
    return first.text if isinstance(first, Text) else first if isinstance(first, str) else ""


def _says_details(row: tuple[Cell, ...], columns: tuple[Column, ...]) -> Iterable[bool]:
    """Yield for every column whether its cell holds the details of the row below its name."""
    for cell, column in zip(row, columns, strict=True):
        yield column.who and isinstance(cell, Text) and bool(cell.below)


def _holds(cell: Cell) -> bool:
    """Return whether a cell holds a value."""
    return cell is not None and cell != ""


def _without_spread(
    columns: tuple[Column, ...], rows: tuple[tuple[Cell, ...], ...]
) -> tuple[list[Column], list[list[Cell]]]:
    """Return columns and rows in which every standard deviation stands below its value."""
    kept = [k for k, column in enumerate(columns) if not column.spread]
    merged = [
        [
            _with_spread(row[k], row[k + 1])
            if k + 1 < len(columns) and columns[k + 1].spread
            else row[k]
            for k in kept
        ]
        for row in rows
    ]
    return [columns[k] for k in kept], merged


def _with_spread(cell: Cell, spread: Cell) -> Cell:
    if not isinstance(cell, Number) or not isinstance(spread, Number):
        return cell
    return replace(cell, below=", ".join(filter(None, (cell.below, f"sd {spread.text}"))))
