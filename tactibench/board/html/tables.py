"""A board's Markdown page as HTML: the very same text, so that the two cannot disagree.

Of the tokens that the parser finds, those are rendered that a page is made of; any other markup is
shown as text, whoever wrote it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING

from tactibench.board.html.bundle import missing
from tactibench.board.html.sorting import sort_value

if TYPE_CHECKING:
    from markdown_it.token import Token

INLINE = {"<br>", "<sub>", "</sub>"}
"""HTML that the pages themselves have inside cells."""
_SUMMARY = re.compile(r"<details><summary>([^<>]*)</summary>\s*")
_PLAIN = {
    "paragraph": "p",
    "bullet_list": "ul",
    "list_item": "li",
    "em": "em",
    "strong": "strong",
    "thead": "thead",
    "tbody": "tbody",
    "tr": "tr",
}


@dataclass(frozen=True)
class Part:
    """What stands below a heading of level 2, before the first of them with an empty title."""

    title: str
    html: str


def page_parts(markdown: str) -> list[Part]:
    """A page in its parts, in order; headings of level 1 are left out."""
    tokens = list(_parsed(markdown))
    starts = [k for k, t in enumerate(tokens) if t.type == "heading_open" and t.tag == "h2"]
    bounds = [0, *starts, len(tokens)]
    parts = []
    for start, end in pairwise(bounds):
        titled = start < len(tokens) and start in starts
        title = _text(tokens[start + 1]) if titled else ""
        body = tokens[start + 3 : end] if titled else tokens[start:end]
        parts.append(Part(title, _Rendered().of(body)))
    return parts


def _parsed(markdown: str) -> Iterable[Token]:
    try:
        from markdown_it import MarkdownIt
    except ImportError:
        raise missing("markdown-it-py") from None
    return MarkdownIt("commonmark").enable("table").parse(markdown)


class _Rendered:
    """Renders tokens in order; a table takes its name from the heading before it."""

    def __init__(self) -> None:
        self._heading = ""
        self._heads: list[str] = []
        self._column = 0

    def of(self, tokens: list[Token]) -> str:
        return "".join(piece for k, token in enumerate(tokens) for piece in self._one(tokens, k))

    def _one(self, tokens: list[Token], k: int) -> Iterator[str]:
        token = tokens[k]
        name, _, side = token.type.rpartition("_")
        if token.type == "heading_open" and token.tag == "h1":
            return
        if name == "heading":
            if side == "open":
                self._heading = _text(tokens[k + 1])
            if token.tag != "h1":
                yield f"<{'/' if side == 'close' else ''}{_level(token.tag)}>"
        elif name == "table":
            yield from self._table(side)
        elif name in ("th", "td"):
            yield from self._cell(tokens, k, name, side)
        elif name in _PLAIN:
            if name == "tr" and side == "open":
                self._column = 0
            yield f"<{'/' if side == 'close' else ''}{_PLAIN[name]}>"
        elif token.type == "inline":
            if not (k and tokens[k - 1].tag == "h1"):
                yield _inline(token.children or [])
        elif token.type in ("fence", "code_block"):
            yield f"<pre tabindex=0>{escape(token.content)}</pre>"
        elif token.type == "html_block":
            yield _block(token.content)

    def _table(self, side: str) -> Iterator[str]:
        if side == "open":
            self._heads = []
            name = escape(self._heading)
            yield (
                f'<div class="scroll" role="region" tabindex="0" aria-label="{name}">'
                '<table class="board">'
            )
        else:
            yield "</table></div>"

    def _cell(self, tokens: list[Token], k: int, name: str, side: str) -> Iterator[str]:
        if side == "close":
            yield f"</{name}>"
            return
        inline, right = tokens[k + 1], "right" in str(tokens[k].attrs.get("style", ""))
        text = _text(inline)
        if name == "th":
            self._heads.append(text)
            yield f'<th scope="col"{_class(right, text)}{_meant(self._heads)}>'
            return
        head = self._heads[self._column] if self._column < len(self._heads) else ""
        self._column += 1
        value = sort_value(_first_line(inline)) if right else None
        sort = "" if value is None else f' data-v="{value:.10g}"'
        yield f"<td{_class(right, head)}{sort}>"


def _class(right: bool, head: str) -> str:
    names = [*(["n"] if right else []), *(["who"] if head == "model" else [])]
    return f' class="{" ".join(names)}"' if names else ""


def _meant(heads: list[str]) -> str:
    """A column of a spread says of what."""
    if heads[-1] != "sd" or len(heads) < 2:
        return ""
    return f' title="standard deviation over training seeds of {escape(heads[-2])}"'


def _level(tag: str) -> str:
    """One deeper than in the page: the protocol's own title stands above all of it."""
    return f"h{int(tag[1]) + 1}"


def _inline(children: Iterable[Token]) -> str:
    return "".join(_leaf(child) for child in children)


def _leaf(token: Token) -> str:
    if token.type == "html_inline" and token.content in INLINE:
        return token.content
    if token.type == "code_inline":
        return f"<code>{escape(token.content)}</code>"
    name, _, side = token.type.rpartition("_")
    if name in ("em", "strong"):
        return f"<{'/' if side == 'close' else ''}{name}>"
    if token.type in ("softbreak", "hardbreak"):
        return "\n"
    if token.type == "image":
        return escape(token.content)
    return escape(token.content)  # links open and close without content: their text remains


def _block(content: str) -> str:
    text = content.strip()
    if text == "</details>":
        return text
    if found := _SUMMARY.fullmatch(text):
        return f"<details><summary>{found[1]}</summary>"
    return "" if text.startswith("<!--") and text.endswith("-->") else f"<p>{escape(text)}</p>"


def _text(inline: Token) -> str:
    """Of a line, what is no markup."""
    return "".join(c.content if c.type != "html_inline" else " " for c in inline.children or [])


def _first_line(inline: Token) -> str:
    """Of a cell, what stands before its interval."""
    text = ""
    for child in inline.children or []:
        if child.type == "html_inline":
            break
        text += child.content
    return text
