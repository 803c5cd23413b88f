"""Tables for a terminal, in which no number is ever cut off."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text as Line

from tactibench.errors import printable
from tactibench.report.table import MISSING, Cell, Column, Number, Table, Text

NARROWEST = 80
"""Width, in characters, that tables are made for; a narrower terminal breaks their lines."""


def print_table(console: Console, table: Table) -> None:
    """Print a table with its title and note."""
    if table.title:
        console.print(Line(table.title, style="bold"))
    console.print(terminal_text(table, max(console.width, NARROWEST)), soft_wrap=True)
    if table.note:
        console.print(Line(table.note, style="dim"))


def terminal_text(table: Table, width: int) -> Line:
    """Return heads, captions and rows at their natural width.

    Optional columns are left out from the right until the table fits, then the gaps shrink.
    """
    columns = [_aligned([row[k] for row in table.rows]) for k in range(len(table.columns))]
    shown, gap = _fitting(table.columns, columns, width)
    widths = [max(map(cell_len, [table.columns[k].head, *columns[k]])) for k in shown]
    sides = [table.columns[k].right for k in shown]
    lines = []
    if any(table.columns[k].head for k in shown):
        heads = [table.columns[k].head for k in shown]
        lines.append(Line(_line(heads, widths, sides, gap), style="dim"))
    narrow = len(shown) < len(table.columns)
    for number in range(len(table.rows)):
        for caption in table.captions.get(number, ()):
            text = ", ".join(filter(None, (caption.text, caption.narrow if narrow else "")))
            wrapped = (fill(line, width) for line in text.split("\n") if line)
            lines.extend(Line(line, style=caption.style) for line in wrapped)
        lines.append(Line(_line([columns[k][number] for k in shown], widths, sides, gap)))
    return Line("\n").join(lines)


def _aligned(cells: Sequence[Cell]) -> list[str]:
    """Return a column as text; the values of numbers are aligned at their right ends."""
    numbers = [cell for cell in cells if isinstance(cell, Number)]
    width = max((len(number.text) for number in numbers), default=0)
    texts = []
    for cell in cells:
        text = _plain(cell)
        if isinstance(cell, Number):
            text = " " * (width - len(cell.text)) + text
        texts.append(text.rjust(width) if cell is None else text)
    return texts


def _plain(cell: Cell) -> str:
    if cell is None:
        return MISSING
    if isinstance(cell, Number):
        return " ".join(filter(None, (str(cell) + cell.mark, cell.below)))
    return printable(" ".join((cell.text if isinstance(cell, Text) else cell).split(" ")))


def _fitting(
    heads: Sequence[Column], columns: Sequence[Sequence[str]], width: int
) -> tuple[list[int], int]:
    """Return the columns that are shown, and the width of the gap between them."""
    widths = [
        max(map(cell_len, [head.head, *cells])) for head, cells in zip(heads, columns, strict=True)
    ]
    shown = list(range(len(heads)))
    while True:
        for gap in (2, 1):
            if sum(widths[k] for k in shown) + gap * (len(shown) - 1) <= width:
                return shown, gap
        optional = [k for k in shown if heads[k].optional]
        if not optional:
            return shown, 2
        shown.remove(optional[-1])


def _line(cells: Sequence[str], widths: Sequence[int], sides: Sequence[bool], gap: int) -> str:
    padded = [
        " " * (width - cell_len(cell)) + cell if right else cell + " " * (width - cell_len(cell))
        for cell, width, right in zip(cells, widths, sides, strict=True)
    ]
    return (" " * gap).join(padded).rstrip()
