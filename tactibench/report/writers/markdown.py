"""Tables and pages in GitHub's Markdown, into which no name or note can add markup."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable

from tactibench.report.document import (
    Block,
    Bullets,
    Fold,
    Group,
    Heading,
    Inline,
    Paragraph,
    Prose,
)
from tactibench.report.table import MISSING, Cell, Number, Table, Text

_MARKUP = re.compile(r"([\\`*_{}\[\]#|~])")


FOLD = '<details markdown="1">'
"""The attribute makes the site's Markdown read the text inside; GitHub reads it anyway."""


def escape(text: str) -> str:
    """Return text that is shown unchanged: on one line, with every character of markup escaped."""
    # Not every Markdown accepts a backslash before < and &; all accept the names of HTML.
    return _MARKUP.sub(r"\\\1", html.escape(" ".join(text.split()), quote=False))


def code(text: str) -> str:
    """Return text in a fixed-width font, without backticks; it can stand in a table, too."""
    return f"`{' '.join(text.split()).replace('`', '').replace('|', '/')}`"


def table_lines(table: Table) -> list[str]:
    """Return the lines of a table, without its title and note."""
    heads = [escape(column.head) for column in table.columns]
    sides = ["---:" if column.right else "---" for column in table.columns]
    rows = [[_cell(cell) for cell in row] for row in table.rows]
    return [f"| {' | '.join(cells)} |" for cells in (heads, sides, *rows)]


def markdown(blocks: Iterable[Block]) -> str:
    """Return the blocks of a page as Markdown, with an empty line between them."""
    return "\n\n".join(text for block in blocks if (text := _block(block)))


def _block(block: Block) -> str:
    if isinstance(block, Heading):
        return f"{'#' * block.level} {escape(block.text)}"
    if isinstance(block, Paragraph):
        return _line(block.parts)
    if isinstance(block, Bullets):
        return "\n".join(f"- {_line(item)}" for item in block.items)
    if isinstance(block, Fold):
        lines = (line.replace("```", "") for line in block.lines)
        summary = f"{FOLD}<summary>{block.summary}</summary>"
        return "\n".join([summary, "", "```text", *lines, "```", "", "</details>"])
    if isinstance(block, Group):
        summary = f"{FOLD}<summary>{html.escape(block.title, quote=False)}</summary>"
        return "\n\n".join([summary, markdown(block.blocks), "</details>"])
    title = [f"### {escape(block.title)}"] if block.title else []
    note = [block.note] if block.note else []
    return "\n\n".join([*title, "\n".join(table_lines(block)), *note])


def _line(parts: Iterable[Inline]) -> str:
    return "".join(_inline(part) for part in parts)


def _inline(part: Inline) -> str:
    return part.text if isinstance(part, Prose) else _words(part)


def _words(text: Text | str) -> str:
    if isinstance(text, str):
        return escape(text)
    if text.style == "code":
        return code(text.text)
    return f"*{escape(text.text)}*" if text.style == "italic" else escape(text.text)


def _cell(cell: Cell) -> str:
    if cell is None:
        return MISSING
    return _number(cell) if isinstance(cell, Number) else _words(cell)


def _number(cell: Number) -> str:
    lines = [escape(cell.text) + escape(cell.mark)]
    if cell.ends is not None:
        lines.append(f"<sub>{' – '.join(cell.ends)}</sub>")
    if cell.below:
        lines.append(f"<sub>{escape(cell.below)}</sub>")
    return "<br>".join(lines)
