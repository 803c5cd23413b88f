"""The table of the whole program: columns, and rows of typed cells; and its form on a terminal.

A cell is a fact: a number with its interval, or a text. It becomes text where it is shown: on a
terminal here, on a page in ``tactibench.report.markdown`` and in the templates.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text as Line

from tactibench.errors import printable
from tactibench.report.labels import Format, fixed

if TYPE_CHECKING:
    from tactibench.board import PooledMetric
    from tactibench.records import Metric

MISSING = "n/a"
"""Text that stands where there is no value."""
NO_INTERVAL = "[none]"
"""Text that stands behind a value from which no interval can be made."""
PERCENT = 100.0
NARROWEST = 80
"""Width, in characters, of lines of words where there is no terminal."""
WORDS = 28
"""Width, in characters, at which words are broken where a table is wider than the terminal."""


@dataclass(frozen=True)
class Number:
    """A number with its interval and marks.

    Attributes:
        value: Value, in the unit of its column.
        write: Makes text from the value and from the ends of its interval.
        interval: Low and high end; an end that is not known is None. None: no interval is shown.
        bound: "<" or ">" where the value is only a bound, "" otherwise.
        below: Text in small letters below the value.
        mark: A sign behind the value that a note explains.
    """

    value: float
    write: Format
    interval: tuple[float | None, float | None] | None = None
    bound: str = ""
    below: str = ""
    mark: str = ""

    @property
    def text(self) -> str:
        """The value alone, such as "0.412" or "< 6.5"."""
        return f"{self.bound} {self.write(self.value)}" if self.bound else self.write(self.value)

    @property
    def ends(self) -> tuple[str, str] | None:
        """The ends of the interval as text; "open" for an end that is not known."""
        if self.interval is None or self.bound:
            return None
        low, high = ("open" if end is None else self.write(end) for end in self.interval)
        return low, high

    @property
    def small(self) -> tuple[str, ...]:
        """Lines that a page shows in small letters below the value."""
        ends = () if self.ends is None else (" – ".join(self.ends),)
        return (*ends, self.below) if self.below else ends

    def __str__(self) -> str:
        """Return the value and its interval in one line, such as "0.412 [0.398, 0.426]"."""
        if self.interval == (None, None) and not self.bound:
            return f"{self.text} {NO_INTERVAL}"
        return self.text if self.ends is None else f"{self.text} [{', '.join(self.ends)}]"


@dataclass(frozen=True)
class Text:
    """Words of a cell.

    Attributes:
        text: The words.
        style: "" (plain), "italic" or "code".
        below: Words in small letters below, on a page.
        link: Address that the words link to on a page, such as "#row"; "" for none.
    """

    text: str
    style: str = ""
    below: str = ""
    link: str = ""

    @property
    def small(self) -> tuple[str, ...]:
        """Lines that a page shows in small letters below the words."""
        return (self.below,) if self.below else ()


Cell = Number | Text | str | None
"""Content of one place of a table; None: there is no value."""


@dataclass(frozen=True)
class Column:
    """A column: its name with the unit, and whether it is aligned to the right, as numbers are."""

    head: str
    right: bool = True


Head = Column | str
"""A column, or the name of a column of words."""


@dataclass(frozen=True)
class Caption:
    """A line above a row of a table: its words, and their style on a terminal."""

    text: str
    style: str = ""


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        columns: Columns from left to right.
        rows: Cells, as many in each row as there are columns.
        title: The heading.
        notes: Sentences below the table; `backticks` mark code.
        captions: Lines above rows, by the number of the row.
        anchors: A name for every row, to which a page can be linked; () for none.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    title: str = ""
    notes: tuple[str, ...] = ()
    captions: Mapping[int, tuple[Caption, ...]] = field(default_factory=dict)
    anchors: tuple[str, ...] = ()


def table(
    heads: Iterable[Head],
    rows: Iterable[Iterable[Cell]],
    *,
    title: str = "",
    notes: Iterable[str] = (),
    anchors: Iterable[str] = (),
) -> Table:
    """Return a table.

    Args:
        heads: One entry a column; a text is the name of a column of words, aligned to the left.
        rows: Cells of every row.
        title: Heading of the table.
        notes: Sentences below the table; empty ones are left out.
        anchors: A name for every row; () for none.
    """
    columns = tuple(Column(head, right=False) if isinstance(head, str) else head for head in heads)
    cells = tuple(tuple(row) for row in rows)
    return Table(columns, cells, title, tuple(filter(None, notes)), anchors=tuple(anchors))


def metric_number(
    metric: Metric | PooledMetric | None, decimals: int, *, interval: bool = True, below: str = ""
) -> Number | None:
    """Return the number of a metric, of one run or over seeds; shares become per cent.

    Args:
        metric: The metric; None: there is none.
        decimals: Number of decimals.
        interval: Whether the interval is shown.
        below: Text below the value.

    Returns:
        None where the metric has no value.
    """
    if metric is None or metric.value is None:
        return None
    scale = PERCENT if metric.unit == "share" else 1.0
    low, high = (None if end is None else end * scale for end in (metric.low, metric.high))
    shown = (low, high) if interval else None
    return Number(metric.value * scale, fixed(decimals), shown, metric.censored or "", below)


def print_table(console: Console, table: Table) -> None:
    """Print a table with its title and notes; on a terminal it is made to fit."""
    if table.title:
        console.print(Line(table.title, style="bold"))
    width = console.width if console.is_terminal else None
    console.print(terminal_text(table, width), soft_wrap=True)
    if table.notes:
        console.print(Line(" ".join(table.notes), style="dim"))


def terminal_text(table: Table, width: int | None = None) -> Line:
    """Return heads, captions and rows, in which no number is ever cut off.

    Where the table is wider than the terminal, words are broken, then columns are left out from the
    right; a last line names them.

    Args:
        table: The table.
        width: Width of the terminal in characters; None: there is none to fit.
    """
    columns = [_aligned([row[k] for row in table.rows]) for k in range(len(table.columns))]
    heads = [[column.head] for column in table.columns]
    if width is not None and _width(heads, columns) > width:
        for k, column in enumerate(table.columns):
            if not column.right:
                columns[k] = [[part for t in texts for part in _broken(t)] for texts in columns[k]]
            heads[k] = _broken(column.head, max(12, _widest(columns[k])))
    count = len(columns)
    while width is not None and count > 2 and _width(heads[:count], columns[:count]) > width:
        count -= 1
    lines = _lines(heads[:count], table.columns, _widths(heads, columns), "dim")
    lines = lines if any(column.head for column in table.columns) else []
    for number in range(len(table.rows)):
        for caption in table.captions.get(number, ()):
            texts = (text for text in caption.text.split("\n") if text)
            wrapped = (textwrap.fill(text, width or NARROWEST) for text in texts)
            lines += [Line(text, style=caption.style) for text in wrapped]
        cells = [column[number] for column in columns[:count]]
        lines += _lines(cells, table.columns, _widths(heads, columns), "")
    if left_out := [column.head for column in table.columns[count:]]:
        text = f"too wide for this terminal: {'; '.join(left_out)}"
        lines.append(Line(textwrap.fill(text, width or len(text)), style="dim"))
    return Line("\n").join(lines)


def _aligned(cells: Sequence[Cell]) -> list[list[str]]:
    """Return a column as texts of one line; values of numbers are aligned at their right ends."""
    width = max((len(cell.text) for cell in cells if isinstance(cell, Number)), default=0)
    texts = []
    for cell in cells:
        if cell is None:
            text = MISSING.rjust(width)
        elif isinstance(cell, Number):
            text = " ".join(filter(None, (str(cell) + cell.mark, cell.below)))
            text = " " * (width - len(cell.text)) + text
        else:
            text = printable(cell.text if isinstance(cell, Text) else cell)
        texts.append(text)
    full = max(map(cell_len, texts), default=0) if width else 0
    return [[text + " " * (full - cell_len(text))] for text in texts]


def _broken(text: str, width: int = WORDS) -> list[str]:
    return textwrap.wrap(text, width, break_long_words=False) or [""]


def _widest(texts: Iterable[Iterable[str]]) -> int:
    return max((cell_len(line) for lines in texts for line in lines), default=0)


def _widths(heads: Sequence[list[str]], columns: Sequence[list[list[str]]]) -> list[int]:
    return [_widest([head, *column]) for head, column in zip(heads, columns, strict=True)]


def _width(heads: Sequence[list[str]], columns: Sequence[list[list[str]]]) -> int:
    return sum(_widths(heads, columns)) + 2 * (len(heads) - 1)


def _lines(
    cells: Sequence[Sequence[str]], columns: Sequence[Column], widths: Sequence[int], style: str
) -> list[Line]:
    """Return the lines of one row, whose cells may have several."""
    lines = []
    for k in range(max(map(len, cells), default=0)):
        padded = []
        for texts, column, width in zip(cells, columns, widths, strict=False):
            text = texts[k] if k < len(texts) else ""
            gap = " " * (width - cell_len(text))
            padded.append(gap + text if column.right else text + gap)
        lines.append(Line("  ".join(padded).rstrip(), style=style))
    return lines
