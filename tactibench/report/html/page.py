"""The pages of a report, one file or a site: one template, filled with boards and their figures.

The same data gives the same bytes. A Content-Security-Policy names the one script by its hash, so
that no other script can run, whatever text a name or note holds.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any

from tactibench import __version__
from tactibench.errors import UserError
from tactibench.report.board_page import (
    READING,
    READING_COSTS,
    BoardPage,
    PageSection,
    board_page,
)
from tactibench.report.document import Block, Bullets, fold_tables
from tactibench.report.html.compact import compact, compact_blocks, named_briefly
from tactibench.report.html.facts import best_rows, machines, models, plan, software
from tactibench.report.html.figures import WITHOUT_FRAMES, Panel, panels
from tactibench.report.html.report_data import ReportBoard, ReportData
from tactibench.report.table import Table
from tactibench.report.writers.html import html, prose_html, table_html

POLICY = (
    "default-src 'none'; script-src '{}'; style-src 'unsafe-inline'; img-src data:; "
    "base-uri 'none'; form-action 'none'"
)


@dataclass(frozen=True)
class SectionView:
    """One sensor on the page.

    Attributes:
        key: Name of its anchor.
        title: Title of the section.
        first: HTML of the table that orders the rows, with everything before it.
        tables: HTML of the other tables.
        panels: The figures.
        lacking: Reason why some figures are missing; "" for none.
    """

    key: str
    title: str
    first: str
    tables: str
    panels: tuple[Panel, ...]
    lacking: str


@dataclass(frozen=True)
class Chapter:
    """One protocol on the page.

    Attributes:
        key: Name of its anchor.
        title: Title of the protocol.
        intro: HTML of the first paragraphs; all text is escaped.
        sections: One view a sensor.
        published: HTML of the published tables; all text is escaped.
    """

    key: str
    title: str
    intro: str
    sections: tuple[SectionView, ...]
    published: str


INDEX = "index.html"
END_LINKS = (("#plan", "Plan"), ("#environment", "Environment"))


def report_page(data: ReportData, *, advance: Callable[[str], None] = lambda _: None) -> str:
    """Return the HTML of a report, all in one file.

    Args:
        data: Data of the report.
        advance: Called with the name of the protocol that is being drawn.

    Raises:
        UserError: The library of the extra ``report`` is missing.
    """
    template = _template()
    pages = _board_pages(data)
    chapters = []
    captions_shown: set[str] = set()
    for board, page in pages:
        advance(board.name)
        chapters.append(_chapter(board, page, captions_shown))
    advance("page")
    glance = _glance(pages, lambda _, anchor: f"#{anchor}")
    links = [("#glance", "At a glance"), *((f"#{c.key}", c.key) for c in chapters), *END_LINKS]
    return _rendered(template, data, pages, chapters, links, glance=glance)


def site_pages(
    data: ReportData, *, advance: Callable[[str], None] = lambda _: None
) -> Iterator[tuple[str, str]]:
    """Yield the name and the HTML of every page of a site: the index, then one page a protocol.

    A row has the address ``PROTOCOL.html#ANCHOR``, which stays when others are added.

    Args:
        data: Data of the site.
        advance: Called with the name of the protocol that is being drawn.

    Raises:
        UserError: The library of the extra ``report`` is missing.
    """
    template = _template()
    pages = _board_pages(data)
    others = [(_file(board), board.name) for board, _ in pages]
    glance = _glance(pages, lambda board, anchor: f"{_file(board)}#{anchor}")
    index = [(INDEX, "All boards"), *others, *END_LINKS]
    advance("page")
    yield INDEX, _rendered(template, data, pages, [], index, glance=glance, here=INDEX)
    for board, page in pages:
        advance(board.name)
        chapters = [_chapter(board, page, set())]
        links, boards = [(INDEX, "All boards"), *others, *END_LINKS], [(board, page)]
        yield _file(board), _rendered(template, data, boards, chapters, links, here=_file(board))


def _file(board: ReportBoard) -> str:
    return f"{board.name.replace('@', '-')}.html"


def _board_pages(data: ReportData) -> list[tuple[ReportBoard, BoardPage]]:
    return [
        (board, board_page(board.protocol, board.records, board.published, board.errors))
        for board in data.boards
    ]


def _glance(
    pages: Sequence[tuple[ReportBoard, BoardPage]], link: Callable[[ReportBoard, str], str]
) -> tuple[Table, ...]:
    """Return the tables over all boards that hold a value."""
    tables = (models([board for board, _ in pages], link), best_rows(pages, link))
    return tuple(table for table in map(compact, tables) if table is not None)


def _rendered(
    template: Any,
    data: ReportData,
    pages: Sequence[tuple[ReportBoard, BoardPage]],
    chapters: Sequence[Chapter],
    links: Sequence[tuple[str, str]],
    *,
    glance: Sequence[Table] | None = None,
    here: str = "",
) -> str:
    """Return a page.

    Args:
        template: Template of all pages.
        data: Data of the report, for the line on the origin of the rows.
        pages: Boards whose protocols, machines and software are listed.
        chapters: Boards that are shown.
        links: Address and name of the chapters, or of the other pages of a site.
        glance: Tables over all boards; None on a page of one board.
        here: The page's own address in a site.
    """
    records = [record for board, _ in pages for record in board.records]
    script = _asset("page.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    text: str = template.render(
        origin=data.origin,
        version=__version__,
        links=links,
        here=here,
        chapters=chapters,
        style=_asset("page.css"),
        script=script,
        policy=POLICY.format(f"sha256-{digest}"),
        glance=glance,
        reading=[READING, READING_COSTS],
        plans=[plan(board) for board, _ in pages],
        environment=[machines(records), software(records)],
    )
    return text


def _chapter(board: ReportBoard, page: BoardPage, said: set[str]) -> Chapter:
    """Return a chapter.

    Args:
        board: Board of the chapter.
        page: Its page.
        said: Captions and notes of papers that the page has so far; new ones are added.
    """
    sections = tuple(
        _section(board, page, section, _anchor(board.name, k), said)
        for k, section in enumerate(page.sections)
    )
    papers = compact_blocks(page.published[1:])  # the template has its heading
    published = html(_new_items(block, said) for block in papers)
    return Chapter(board.name, page.title, html(page.intro), sections, published)


def _new_items(block: Block, said: set[str]) -> Block:
    """Return a list without the items that the page has shown before."""
    if not isinstance(block, Bullets):
        return block
    return Bullets(tuple(item for item in block.items if _once(repr(item), said)))


def _once(text: str, said: set[str]) -> str:
    """Return a text that the page has not shown before, else ""."""
    new = "" if text in said else text
    said.add(text)
    return new


def _section(
    board: ReportBoard, page: BoardPage, section: PageSection, key: str, said: set[str]
) -> SectionView:
    stored = any(row.first.name in board.runs for row in section.rows)
    lacking = board.protocol.spec.answer == "contacts" and not stored
    blocks = compact_blocks(section.blocks)
    first = next((k + 1 for k, block in enumerate(blocks) if isinstance(block, Table)), len(blocks))
    blocks[first:] = named_briefly(blocks[first:])
    return SectionView(
        key,
        section.title,
        html(blocks[:first]),
        html(fold_tables(blocks[first:], 0)),
        tuple(
            replace(panel, caption=_once(panel.caption, said))
            for panel in panels(section, board, [other.section for other in page.sections])
        ),
        _once(WITHOUT_FRAMES, said).format(board.name) if lacking else "",
    )


def _anchor(name: str, number: int) -> str:
    return re.sub(r"[^a-z0-9-]", "-", f"{name}-{number}")


def _template() -> Any:
    try:
        from jinja2 import Environment, StrictUndefined
        from markupsafe import Markup
    except ImportError:
        raise UserError(
            "the HTML report needs jinja2, which is not installed; run "
            "`pip install 'tactibench[report]'`."
        ) from None
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    for name, write in (("table", _compact_html), ("prose", prose_html), ("blocks", html)):
        environment.filters[name] = _marked(Markup, write)
    return environment.from_string(_asset("page.html.j2"))


def _compact_html(table: Table) -> str:
    shown = compact(table)
    return "" if shown is None else table_html(shown)


def _marked(markup: type[str], write: Callable[[Any], str]) -> Callable[[Any], str]:
    return lambda value: markup(write(value))  # the writers escape every text


def _asset(name: str) -> str:
    return (files("tactibench.report.html") / "assets" / name).read_text(encoding="utf-8")
