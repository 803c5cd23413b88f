"""Markdown that the pages share."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from inspect import cleandoc

SECTIONS = ("Args:", "Attributes:", "Returns:", "Raises:")


def prose(docstring: str | None) -> list[str]:
    """Return a docstring as lines of Markdown: ``code`` in single backticks, examples fenced."""
    lines: list[str] = []
    for block in re.split(r"\n\s*\n", cleandoc(docstring or "")):
        text = block.splitlines()
        if text and text[0].strip() == "\b":  # click: keep the lines as they are
            typed = all(line.startswith("tactibench ") for line in text[1:])
            shown = [f"$ {line}" for line in text[1:]] if typed else text[1:]
            lines += ["```console" if typed else "```text", *shown, "```", ""]
        elif text and all(line.startswith("    ") for line in text):
            lines += ["```text", *(line[4:] for line in text), "```", ""]
        elif text and text[0] == "Returns:":
            lines += [text[0], "", *(plain(line.strip()) for line in text[1:]), ""]
        elif text and text[0] in SECTIONS:
            lines += [text[0], "", *_items(text[1:]), ""]
        else:
            lines += [*(plain(line) for line in text), ""]
    return lines[:-1]


def _items(text: Sequence[str]) -> list[str]:
    """Return the entries of a section such as ``Args:`` as a list."""
    items: list[str] = []
    for line in text:
        if line.startswith("     "):
            items[-1] += f" {line.strip()}"
        else:
            items.append(line.strip())
    named = (item.partition(": ") for item in items)
    return [f"- `{name}`: {plain(meaning)}" for name, _, meaning in named]


def plain(text: str) -> str:
    """Return text outside a fence: code in single backticks, and nothing that reads as a tag."""
    parts = text.replace("``", "`").split("`")
    # Every other part stands between backticks, where nothing is markup.
    return "`".join(p if k % 2 else _escaped(p) for k, p in enumerate(parts))


def _escaped(text: str) -> str:
    return re.sub(r"([*\[\]])", r"\\\1", text.replace("<", "&lt;").replace("_", "\\_"))


def cell(text: str) -> str:
    """Return text for a cell of a table."""
    return plain(" ".join(text.split())).replace("|", "\\|")


def code(text: str) -> str:
    """Return code for a cell of a table without bars, which GitHub and mkdocs read differently."""
    return f"`{text.replace(' | ', '|').replace('|', ' or ')}`"


def grid(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table with left-aligned columns, and a blank line before and after."""
    lines = (heads, ["---"] * len(heads), *rows)
    return ["", *(f"| {' | '.join(cells)} |" for cells in lines), ""]


def fenced(text: str, language: str = "python") -> list[str]:
    """Return the text in a fence."""
    return [f"```{language}", *text.strip("\n").splitlines(), "```", ""]


def anchor(heading: str) -> str:
    """Return the anchor of a heading, as GitHub and mkdocs make it."""
    text = re.sub(r"[^\w\- ]", "", heading.lower())
    return text.strip().replace(" ", "-")


def single_spaced(lines: Iterable[str]) -> list[str]:
    """Return lines with at most one blank line in a row outside fences, and none at the end."""
    result: list[str] = []
    inside = False
    for line in lines:
        inside ^= line.startswith("```")
        if line or inside or result[-1]:
            result.append(line)
    return result if result[-1] else result[:-1]
