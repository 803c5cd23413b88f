"""Numbers as text, and tables in which no number is ever cut."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.measure import Measurement
from rich.segment import Segments
from rich.table import Table
from rich.text import Text

from tactibench.board.numbers import number
from tactibench.records.record import Metric

Cells = tuple[str, ...]
UNLIMITED = 1000


def estimate(row: Metric | None, decimals: int) -> str:
    """Value and interval, a limit, or n/a: "0.412 [0.398, 0.426]", "< 6.5". Shares in per cent.

    An end of the interval that is not known reads "open".
    """
    if row is None or row.value is None:
        return "n/a"
    scale = 100.0 if row.unit == "share" else 1.0
    if row.censored:
        return f"{row.censored} {row.value * scale:.4g}"
    text = number(row.value * scale, decimals)
    if row.low is None and row.high is None:
        return f"{text} [n/a]"
    low, high = (
        "open" if end is None else number(end * scale, decimals) for end in (row.low, row.high)
    )
    return f"{text} [{low}, {high}]"


def aligned(column: Sequence[str]) -> list[str]:
    """Cells whose first words end at the same place, so that values stand under each other."""
    width = max((len(cell.split(" ", 1)[0]) for cell in column), default=0)
    return [" " * (width - len(cell.split(" ", 1)[0])) + cell for cell in column]


def span(values: Iterable[int]) -> str:
    """ "1,000" or "998 to 1,000"."""
    known = list(values)
    low, high = min(known, default=0), max(known, default=0)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def print_grid(
    console: Console,
    heads: Sequence[str],
    rows: Iterable[Cells],
    *,
    right: frozenset[str] = frozenset(),
    widths: Sequence[int] | None = None,
    gap: int = 2,
    show_heads: bool = True,
) -> None:
    """Print a plain table at its natural width; a narrower terminal breaks lines, nothing is cut.

    right: heads of right-justified columns. widths: of the columns, where several tables line up.
    """
    table = Table(
        box=None, padding=(0, gap, 0, 0), pad_edge=False, header_style="dim", show_header=show_heads
    )
    for k, head in enumerate(heads):
        table.add_column(
            head,
            justify="right" if head in right else "left",
            no_wrap=True,
            min_width=widths[k] if widths else None,
        )
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    natural = Measurement.get(console, console.options.update_width(UNLIMITED), table).maximum
    drawn = console.render(table, console.options.update_width(natural))
    console.print(Segments(drawn), crop=False, end="")  # print() alone would narrow the table
