"""Tables in GitHub's Markdown, into which no name or note can bring markup of its own."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

_MARKUP = re.compile(r"([\\`*_{}\[\]<>#|~&])")


def plain(text: str) -> str:
    """Text that is shown as it is: one line, every character of markup escaped."""
    return _MARKUP.sub(r"\\\1", " ".join(text.split()))


def code(text: str) -> str:
    """Text in a fixed pitch, backticks left out, for table cells too."""
    return f"`{' '.join(text.split()).replace('`', '').replace('|', '/')}`"


@dataclass(frozen=True)
class Head:
    """Head of a column; numbers stand to the right."""

    text: str
    right: bool = True


def table(heads: Sequence[Head], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table. Cells are Markdown already."""
    lines = [_line(head.text for head in heads)]
    lines.append(_line("---:" if head.right else "---" for head in heads))
    return [*lines, *(_line(row) for row in rows)]


def details(summary: str, lines: Iterable[str]) -> list[str]:
    """Lines of text behind a summary that a reader opens; each keeps its own line."""
    safe = (line.replace("```", "") for line in lines)
    return [f"<details><summary>{summary}</summary>", "", "```text", *safe, "```", "", "</details>"]


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"
