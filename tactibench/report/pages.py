"""Markdown and HTML out of templates, into which no name or note can add markup."""

from __future__ import annotations

import html
import re
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from tactibench.report.tables import MISSING, Cell, Number, Table

MADE = "<!-- Made by `tactibench board write` from submissions/; do not edit. -->"
"""Second line of every page of a board."""
_MARKUP = re.compile(r"([\\`*_{}\[\]#|~])")
_CODE = re.compile(r"`([^`]*)`")


def render(template: str, **values: Any) -> str:
    """Return a template of this package, filled with values.

    Args:
        template: Name of the file, such as "board.md.j2".
        values: What the template names.
    """
    return _environment().get_template(template).render(**values)


def asset(name: str) -> str:
    """Return the text of a file beside the templates."""
    return (files("tactibench.report") / "templates" / name).read_text(encoding="utf-8")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FunctionLoader(asset),
        autoescape=select_autoescape(["html.j2"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["made"] = MADE
    environment.filters |= {
        "md": escape,
        "md_prose": prose_markdown,
        "md_table": _markdown_table,
        "prose": prose_html,
    }
    return environment


def prose_html(text: str) -> Markup:
    """Return words as HTML; `backticks` become code."""
    shown = _CODE.sub(r"<code>\1</code>", html.escape(text, quote=False))
    return Markup(shown)  # noqa: S704 - escaped above # nosec B704


def prose_markdown(text: str) -> str:
    """Return words as Markdown; `backticks` mark code, all other markup is escaped."""
    parts = _CODE.split(" ".join(text.split()))  # words and code by turns
    return "".join(code(part) if k % 2 else _escaped(part) for k, part in enumerate(parts))


def escape(text: str) -> str:
    """Return text that Markdown shows unchanged: on one line, with all markup escaped."""
    return _escaped(" ".join(text.split()))


def _escaped(text: str) -> str:
    # Not every Markdown accepts a backslash before < and &; all accept the names of HTML.
    return _MARKUP.sub(r"\\\1", html.escape(text, quote=False))


def code(text: str) -> str:
    """Return text in a fixed-width font, without backticks; it can stand in a table, too."""
    return f"`{' '.join(text.split()).replace('`', '').replace('|', '/')}`"


def table_lines(table: Table) -> list[str]:
    """Return the lines of a table in Markdown, without its title and notes."""
    heads = [escape(column.head) for column in table.columns]
    sides = ["---:" if column.right else "---" for column in table.columns]
    rows = [[_markdown_cell(cell) for cell in row] for row in table.rows]
    return [f"| {' | '.join(cells)} |" for cells in (heads, sides, *rows)]


def _markdown_table(table: Table) -> str:
    return "\n".join(table_lines(table))


def _markdown_cell(cell: Cell) -> str:
    if cell is None:
        return MISSING
    if isinstance(cell, str):
        return escape(cell)
    if isinstance(cell, Number):
        text = escape(cell.text + cell.mark)
    else:
        text = code(cell.text) if cell.style == "code" else escape(cell.text)
        text = f"*{text}*" if cell.style == "italic" else text
    return "".join([text, *(f"<br><sub>{escape(line)}</sub>" for line in cell.small)])
