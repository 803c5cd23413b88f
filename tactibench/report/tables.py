"""The table of the whole program: columns, and rows of typed cells; and its form on a terminal.

A cell is a fact: a number with its interval, or a text. It becomes text where it is shown: on a
terminal here, on a page in ``tactibench.report.pages`` and in the templates.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text as Line

from tactibench.errors import UserError, printable
from tactibench.metrics import find_metric

if TYPE_CHECKING:
    from tactibench.board import PooledMetric
    from tactibench.protocols import PublishedRow, Ranking
    from tactibench.records import Metric

MISSING = "n/a"
"""Text that stands where there is no value."""
NO_INTERVAL = "[none]"
"""Text that stands behind a value from which no interval can be made."""
PERCENT = 100.0
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
class Table:
    """A table.

    Attributes:
        columns: Columns from left to right.
        rows: Cells, as many in each row as there are columns.
        title: The heading.
        notes: Sentences below the table; `backticks` mark code.
        anchors: A name for every row, to which a page can be linked; () for none.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    title: str = ""
    notes: tuple[str, ...] = ()
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
    return Table(columns, cells, title, tuple(filter(None, notes)), tuple(anchors))


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


def error_words(error: Ranking, value: Metric | PooledMetric | None) -> tuple[str, Number | None]:
    """Return the head of a column of an error, such as "depth MAE, mm", and a value in it."""
    share = is_share(error.metric)
    head = f"{error.name}, %" if share else error.head
    return head, metric_number(value, 1 if share else error.decimals)


def published_number(row: PublishedRow, metric: str, group: str, decimals: int) -> Number | None:
    """Return a value of a paper, with no more digits than the paper or the column has."""
    value = row.value(metric, group)
    if value is None:
        return None
    if is_share(metric):
        return Number(PERCENT * value, fixed(min(max(row.decimals - 2, 0), decimals)))
    return Number(value, fixed(min(row.decimals, decimals)))


def print_table(console: Console, table: Table) -> None:
    """Print a table with its title and notes; on a terminal it is made to fit."""
    if table.title:
        console.print(Line(table.title, style="bold"))
    width = console.width if console.is_terminal else None
    console.print(terminal_text(table, width), soft_wrap=True)
    if table.notes:
        console.print(Line(" ".join(table.notes), style="dim"))


def terminal_text(table: Table, width: int | None = None) -> Line:
    """Return heads and rows, in which no number is ever cut off.

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


Format = Callable[[float], str]


HUGE = 1e6
"""Values of which no digits are shown behind the point, such as errors of kilometres in mm."""


def number(value: float, decimals: int) -> str:
    """Return a value with fixed decimals; one that would read as zero, or fill a line, is short."""
    if value and abs(value) < 0.5 * 10.0**-decimals:
        return f"{value:.0e}"
    if decimals and abs(value) >= HUGE:
        return f"{value:.2e}"
    return f"{value:,.{decimals}f}"


def fixed(decimals: int) -> Format:
    """Return the format with this number of decimals."""
    return partial(number, decimals=decimals)


def significant(value: float, digits: int = 3) -> str:
    """Return a value with at least ``digits`` significant digits: 0.0123, 6.12, 1,234."""
    if not value:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:,.{decimals}f}"


def general(value: float) -> str:
    """Return a value with three significant digits, without trailing zeros: 0.21, 6.5, 64."""
    return f"{value:.3g}"


def scaled(value: float) -> str:
    """Return a large count with its prefix: 950, 12.3 k, 1.93 M, 2.1 G."""
    for size, prefix in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if abs(value) >= size:
            return f"{value / size:.3g}{prefix}"
    return f"{value:.4g}"


def duration(seconds: float) -> str:
    """Return a time in words, such as "0.4 s", "38 s", "4 min 5 s" or "1 h 2 min"."""
    if seconds < 59.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


def span(counts: Iterable[int]) -> str:
    """Return the range of counts: "1,000", or "998 to 1,000" where they differ."""
    numbers = list(counts)
    low, high = min(numbers, default=0), max(numbers, default=0)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def plural(count: int, noun: str) -> str:
    """Return a count with its noun: "1 seed", "3 seeds"."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


HEADS = {
    "coverage": "coverage, %",
    "depth_mae_mm": "depth, mm",
    "distance_mae_mm": "error, mm",
    "distance_penalised_mm": "penalised, mm",
    "mae_mm": "MAE, mm",
    "missed": "missed, %",
    "orientation_mae_deg": "turn, deg",
    "position_mean_mm": "position, mm",
    "r2": "R2",
    "resolved": "resolved, %",
    "rmse_mm": "RMSE, mm",
    "tilt_mae_deg": "tilt, deg",
}
"""Heads of columns."""

NAMES = {
    "brier": "Brier score",
    "catch_resolved": "single presses seen as two",
    "coverage": "coverage",
    "d_prime": "d' of one against two",
    "depth_mae_minus_published_mm": "depth error minus released",
    "depth_mae_minus_published_p": "p of that",
    "depth_mae_mm": "depth error",
    "distance_mae_mm": "distance error",
    "distance_penalised_mm": "penalised distance error",
    "doubles_at": "value at which the error doubles",
    "ellipse_50": "truth inside the stated 50 % ellipse",
    "ellipse_90": "truth inside the stated 90 % ellipse",
    "ellipse_95": "truth inside the stated 95 % ellipse",
    "error_ratio": "error / error of the easy case",
    "exact": "set right",
    "f1": "F1 of a place",
    "false_per_1000": "false contacts per 1,000 empty frames",
    "force_mae_n": "force error",
    "gospa_depth_mm": "GOSPA",
    "gospa1_mm": "GOSPA in the plane",
    "gospa2_mm": "GOSPA, p = 2",
    "mae_mm": "MAE",
    "missed": "missed contacts",
    "nll": "negative log likelihood",
    "not_finite": "frames answered with NaN or infinity",
    "number_error": "error of the number",
    "orientation_mae_deg": "orientation error of the pair",
    "ospa_mm": "error a contact (OSPA, p = 1)",
    "position_mean_mm": "position error",
    "position_ungated_mm": "position error without gate",
    "r2": "R2",
    "raised": "frames on which the model raised an exception",
    "relative_depth_mae_mm": "relative depth error",
    "resolved": "resolved as two",
    "rms_z": "RMS of error / stated std",
    "rmse_mm": "RMSE",
    "rmse_over_bound": "RMSE / Cramer-Rao bound",
    "rmse_pooled_mm": "RMSE pooled over axes",
    "spurious": "spurious contacts per frame",
    "std_over_bound": "stated std / Cramer-Rao bound",
    "surface_excess_mm": "surface RMSE above the floor",
    "surface_floor_mm": "surface floor of the encoder",
    "surface_rmse_mm": "surface RMSE of the heatmap",
    "threshold_deviance": "misfit of the threshold's curve, deviance",
    "threshold_freedom": "its degrees of freedom",
    "threshold_lapse": "share of pairs lost at any distance",
    "threshold_mm": "two-point threshold (75 %)",
    "threshold_p": "its p",
    "limit_mm": "two-point limit of the noise",
    "tilt_mae_deg": "tilt error",
    "tilt_mae_minus_published_deg": "tilt error minus released",
    "tilt_mae_minus_published_p": "p of that",
    "told": "right, number told",
    "wrong_set": "set not right",
    "worst_ratio": "largest error / error of the easy case",
}
"""Names in sentences and lists."""

UNITS = {"share": "%", "per frame": "", "1": ""}
"""Units as they are written behind a name; "spurious per frame" holds its own."""


def is_share(metric: str) -> bool:
    """Return whether a metric lies in 0..1 and is shown in per cent."""
    try:
        return find_metric(metric).unit == "share"
    except UserError:  # a column of a published table
        return False


def named(metric: str, unit: str) -> str:
    """Return the name of a metric with its unit, such as "distance error, mm"."""
    shown = UNITS.get(unit, unit)
    return f"{NAMES.get(metric, metric)}, {shown}" if shown else NAMES.get(metric, metric)
