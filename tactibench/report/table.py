"""The table of the whole program: columns, and rows of typed cells.

A cell is a fact: a number with its interval, or a text. It becomes text in a writer
(``tactibench.report.writers``) and nowhere else.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tactibench.report.numbers import Format, fixed

if TYPE_CHECKING:
    from tactibench.board import PooledMetric
    from tactibench.records import Metric

MISSING = "n/a"
"""Text that stands where there is no value."""
NO_INTERVAL = "[none]"
"""Text that stands behind a value from which no interval can be made."""
PERCENT = 100.0


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

    def __str__(self) -> str:
        """Return the value and its interval in one line, such as "0.412 [0.398, 0.426]"."""
        if self.interval == (None, None) and not self.bound:
            return f"{self.text} {NO_INTERVAL}"
        return self.text if self.ends is None else f"{self.text} [{', '.join(self.ends)}]"


@dataclass(frozen=True)
class Text:
    """Words of a cell or a paragraph.

    Attributes:
        text: The words.
        style: "" (plain), "italic" or "code".
        below: Words that stand below on a page that leaves the columns of detail out.
        link: Address that the words link to on a page, such as "#row"; "" for none.
        brief: Whether a page hides the words below, which only its filter finds then.
    """

    text: str
    style: str = ""
    below: str = ""
    link: str = ""
    brief: bool = False


Cell = Number | Text | str | None
"""Content of one place of a table; None: there is no value."""


@dataclass(frozen=True)
class Column:
    """A column.

    Attributes:
        head: Name of the column, with the unit.
        right: Whether cells are aligned to the right, as numbers are.
        title: An explanation of the head, for a page.
        optional: Whether a narrow terminal may leave the column out.
        who: Whether the column names its row; it stays in view when a page scrolls.
        detail: Whether the column qualifies the name of the row, which says it as well.
        spread: Whether the column is the standard deviation of the column before it.
    """

    head: str
    right: bool = True
    title: str = ""
    optional: bool = False
    who: bool = False
    detail: bool = False
    spread: bool = False


Head = Column | str
"""A column, or the name of a column of words."""


@dataclass(frozen=True)
class Caption:
    """A line above a row of a table.

    Attributes:
        text: Words of the line.
        style: Style of the words, for a terminal.
        narrow: Words that are added where optional columns are left out.
    """

    text: str
    style: str = ""
    narrow: str = ""


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        columns: Columns from left to right.
        rows: Cells, as many in each row as there are columns.
        title: The heading.
        note: A paragraph below the table.
        guide: How to read tables of this kind; a page shows it before the note of the first such
            table.
        captions: Lines above rows, by the number of the row.
        anchors: A name for every row, to which a page can be linked; () for none.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    title: str = ""
    note: str = ""
    guide: str = field(default="", kw_only=True)
    captions: Mapping[int, tuple[Caption, ...]] = field(default_factory=dict)
    anchors: tuple[str, ...] = ()


def table(
    heads: Iterable[Head], rows: Iterable[Iterable[Cell]], *, title: str = "", note: str = ""
) -> Table:
    """Return a table.

    Args:
        heads: One entry a column; a text is the name of a column of words, aligned to the left.
        rows: Cells of every row.
        title: Heading of the table.
        note: Paragraph below the table.
    """
    columns = tuple(Column(head, right=False) if isinstance(head, str) else head for head in heads)
    return Table(columns, tuple(tuple(row) for row in rows), title, note)


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
