"""The first table of every board as LaTeX, for a paper: booktabs, one table a sensor."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from tactibench.board.columns import Column
from tactibench.board.numbers import number
from tactibench.board.ranks import Ranks
from tactibench.board.rows import Row

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


def escaped(text: str) -> str:
    """Text that LaTeX prints as it is, on one line."""
    return _ANY.sub(lambda found: _SPECIAL[found[0]], " ".join(text.split()))


def latex_table(
    title: str, rows: Sequence[Row], columns: Sequence[Column], ranks: Ranks | None
) -> str:
    """A ``table`` environment: rank, model, encoder, regime, seeds, and value with interval.

    title: of the section. Shares are in per cent. The signatures follow as comments.
    """
    numbers = (None,) * len(rows) if ranks is None else ranks.by_row
    heads = ["", "model", "encoder", "regime", "seeds", *(column.head for column in columns)]
    body = [
        " & ".join(
            [
                MISSING if rank is None else str(rank),
                *_who(row),
                *(_cell(row, column) for column in columns),
            ]
        )
        for rank, row in zip(numbers, rows, strict=True)
    ]
    signatures = [record.signature for row in rows for record in row.records]
    return "\n".join(
        [
            "% " + " ".join(title.split()),
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{escaped(title)}; mean over seeds [95\,\% interval over presses].}}",
            rf"\begin{{tabular}}{{rlllr{'r' * len(columns)}}}",
            r"\toprule",
            " & ".join(map(escaped, heads)) + r" \\",
            r"\midrule",
            *(f"{line} \\\\" for line in body),
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            *("% " + " ".join(text.split()) for text in signatures),
            "",
        ]
    )


def _who(row: Row) -> Iterable[str]:
    model = escaped(row.model)
    yield rf"\textit{{{model}}}" if row.trivial else model
    yield escaped(row.encoder) or MISSING
    yield escaped(row.regime)
    yield str(len(row.records))


def _cell(row: Row, column: Column) -> str:
    found = row.metric(column.metric, column.group)
    if found is None:
        return MISSING
    scale = 100.0 if found.unit == "share" else 1.0
    text = number(found.value * scale, column.decimals)
    if found.censored:
        return escaped(f"{found.censored} {text}")
    if not column.interval or found.low is None or found.high is None:
        return text
    ends = (number(end * scale, column.decimals) for end in (found.low, found.high))
    return f"{text} {{\\scriptsize [{', '.join(ends)}]}}"
