"""Tables as LaTeX with booktabs, for a paper."""

from __future__ import annotations

import re
from collections.abc import Iterable

from tactibench.report.table import Cell, Number, Table, Text

_SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
}
_ANY = re.compile("|".join(map(re.escape, _SPECIAL)))
MISSING = "--"
_STYLES = {"italic": "textit", "code": "texttt"}


def escape(text: str) -> str:
    """Return text that LaTeX prints unchanged, on one line."""
    return _ANY.sub(lambda match: _SPECIAL[match[0]], " ".join(text.split()))


def latex_text(table: Table, comments: Iterable[str] = ()) -> str:
    """Return a ``table`` environment; the note of the table is part of the caption.

    Args:
        table: The table.
        comments: Lines of comments that follow the table.
    """
    sides = "".join("r" if column.right else "l" for column in table.columns)
    caption = escape(table.title) + (f"; {table.note}" if table.note else "")
    lines = [
        "% " + " ".join(table.title.split()),
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{caption}.}}",
        rf"\begin{{tabular}}{{{sides}}}",
        r"\toprule",
        " & ".join(escape(column.head) for column in table.columns) + r" \\",
        r"\midrule",
        *(" & ".join(map(_cell, row)) + r" \\" for row in table.rows),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
        *("% " + " ".join(text.split()) for text in comments),
    ]
    return "\n".join(lines) + "\n"


def _cell(cell: Cell) -> str:
    if cell is None:
        return MISSING
    if isinstance(cell, Number):
        ends = "" if cell.ends is None else rf" {{\scriptsize [{', '.join(cell.ends)}]}}"
        return escape(cell.text) + ends
    text = Text(cell) if isinstance(cell, str) else cell
    style = _STYLES.get(text.style)
    return rf"\{style}{{{escape(text.text)}}}" if style else escape(text.text)
