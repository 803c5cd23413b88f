"""A page before it is Markdown or HTML: headings, paragraphs, lists, tables.

Text of this program is ``Prose``, in which `...` is code. All other text (names, notes, titles of
papers) is a plain string, which every writer escapes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from tactibench.report.table import Table, Text


@dataclass(frozen=True)
class Prose:
    """Words of this program; `backticks` mark code."""

    text: str


Inline = Prose | Text | str


@dataclass(frozen=True)
class Heading:
    """A heading; level 1 is the title of the page."""

    level: int
    text: str


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of words."""

    parts: tuple[Inline, ...]


@dataclass(frozen=True)
class Bullets:
    """A list."""

    items: tuple[tuple[Inline, ...], ...]


@dataclass(frozen=True)
class Fold:
    """Lines in a fixed-width font behind a summary that a reader opens."""

    summary: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Group:
    """Blocks that are folded away behind their title."""

    title: str
    blocks: tuple[Block, ...]


Block = Heading | Paragraph | Bullets | Fold | Group | Table


def prose(text: str) -> Paragraph:
    """Return a paragraph with words of this program."""
    return Paragraph((Prose(text),))


def fold_tables(blocks: Iterable[Block], shown: int) -> list[Block]:
    """Return the blocks, with the later tables folded behind their titles.

    Args:
        blocks: Blocks of a page.
        shown: Number of tables that stay as they are.
    """
    result: list[Block] = []
    for block in blocks:
        if not isinstance(block, Table) or not block.title:
            result.append(block)
        elif shown:
            result.append(block)
            shown -= 1
        else:
            result.append(Group(block.title, (replace(block, title=""),)))
    return result


def say_once(blocks: Iterable[Block], said: set[str], noted: set[str]) -> tuple[Block, ...]:
    """Return the blocks with guides and notes of tables only where no earlier table has the same.

    Args:
        blocks: Blocks of one section.
        said: Guides of the page so far; new ones are added.
        noted: Notes of the section so far; new ones are added.
    """
    result: list[Block] = []
    for block in blocks:
        if isinstance(block, Group):
            result.append(replace(block, blocks=say_once(block.blocks, said, noted)))
        elif isinstance(block, Table):
            guide = "" if block.guide in said else block.guide
            note = "" if block.note in noted else block.note
            said.add(block.guide)
            noted.add(block.note)
            result.append(replace(block, note=" ".join(filter(None, (guide, note))), guide=""))
        else:
            result.append(block)
    return tuple(result)
