"""Tables and pages as HTML; all text is escaped, so that no name or note can add markup.

Number cells carry their value for sorting (``data-v``): nothing is read back from the text.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from html import escape

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
from tactibench.report.table import MISSING, Cell, Column, Number, Table, Text

_CODE = re.compile(r"`([^`]*)`")
_ESCAPED_SIGN = re.compile(r"\\([*_])")
_STYLES = {"italic": "em", "code": "code"}


def html(blocks: Iterable[Block]) -> str:
    """Return the blocks of a page; headings are one level deeper than in the Markdown page."""
    return "\n".join(_block(block) for block in blocks)


def table_html(table: Table) -> str:
    """Return a table that a page can sort, with its note below and without its title."""
    heads = "".join(_head(column) for column in table.columns)
    names = table.anchors or ("",) * len(table.rows)
    rows = "\n".join(
        f"<tr{_id(name)}>"
        + "".join(_cell(*pair, name) for pair in zip(row, table.columns, strict=True))
        + "</tr>"
        for row, name in zip(table.rows, names, strict=True)
    )
    note = f'\n<p class="note">{prose_html(table.note)}</p>' if table.note else ""
    return (
        f'<div class="scroll" role="region" tabindex="0" aria-label="{escape(table.title)}">\n'
        f'<table class="board">\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody>'
        f"</table></div>{note}"
    )


def prose_html(text: str) -> str:
    """Return words of this program as HTML: `backticks` become code, an escaped star a star."""
    return _ESCAPED_SIGN.sub(r"\1", _CODE.sub(r"<code>\1</code>", escape(text, quote=False)))


def _block(block: Block) -> str:
    if isinstance(block, Heading):
        return f"<h{block.level + 1}>{escape(block.text)}</h{block.level + 1}>"
    if isinstance(block, Paragraph):
        return f"<p>{_line(block.parts)}</p>"
    if isinstance(block, Bullets):
        return f"<ul>{''.join(f'<li>{_line(item)}</li>' for item in block.items)}</ul>"
    if isinstance(block, Fold):
        lines = escape("\n".join(block.lines))
        return (
            f"<details><summary>{escape(block.summary)}</summary>"
            f"<pre tabindex=0>{lines}</pre></details>"
        )
    if isinstance(block, Group):
        return (
            f'<details class="group"><summary>{escape(block.title)}</summary>\n'
            f"{html(block.blocks)}</details>"
        )
    title = f"<h4>{escape(block.title)}</h4>\n" if block.title else ""
    return title + table_html(block)


def _line(parts: Iterable[Inline]) -> str:
    return "".join(_inline(part) for part in parts)


def _inline(part: Inline) -> str:
    return prose_html(part.text) if isinstance(part, Prose) else _words(part)


def _words(text: Text | str) -> str:
    if isinstance(text, str):
        return escape(text)
    words = escape(text.text)
    if text.link:
        words = f'<a href="{escape(text.link)}">{words}</a>'
    tag = _STYLES.get(text.style)
    return f"<{tag}>{words}</{tag}>" if tag else words


def _head(column: Column) -> str:
    title = f' title="{escape(column.title)}"' if column.title else ""
    return f'<th scope="col"{_class(column)}{title}>{escape(column.head)}</th>'


def _id(name: str) -> str:
    return f' id="{escape(name)}"' if name else ""


def _cell(cell: Cell, column: Column, anchor: str) -> str:
    value = f' data-v="{cell.value:.10g}"' if isinstance(cell, Number) else ""
    if isinstance(cell, Text) and cell.brief:
        value = f' data-more="{escape(cell.below)}"'
    link = ""
    if column.who and anchor:
        link = f'<a class="link" href="#{escape(anchor)}" aria-label="Link to this row">#</a>'
    return f"<td{_class(column)}{value}>{_content(cell)}{link}</td>"


def _class(column: Column) -> str:
    names = [*(["n"] if column.right else []), *(["who"] if column.who else [])]
    return f' class="{" ".join(names)}"' if names else ""


def _content(cell: Cell) -> str:
    if cell is None:
        return f'<span class="na">{MISSING}</span>'
    if isinstance(cell, Number):
        lines = [escape(cell.text + cell.mark)]
        if cell.ends is not None:
            lines.append(f"<sub>{' – '.join(cell.ends)}</sub>")
        if cell.below:
            lines.append(f"<sub>{escape(cell.below)}</sub>")
        return "<br>".join(lines)
    if not isinstance(cell, Text) or not cell.below or cell.brief:
        return _words(cell)
    return f"{_words(cell)}<br><sub>{escape(cell.below)}</sub>"
