"""One protocol in the report: its page's own text, with figures below every sensor's heading."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tactibench.board.html.distance import distance_panels
from tactibench.board.html.drawn import Drawer
from tactibench.board.html.error_map import error_maps
from tactibench.board.html.figure import Looks, Panel
from tactibench.board.html.frontier import frontier_panel
from tactibench.board.html.material import Board
from tactibench.board.html.opened import Opened
from tactibench.board.html.surface import LACKING, relief
from tactibench.board.html.tables import Part, page_parts
from tactibench.board.html.worst import worst_frames
from tactibench.board.labels import whole
from tactibench.board.page import page
from tactibench.board.ranking import RANKING, ordered
from tactibench.board.sections import Section, sections_of

WITHOUT_TRUTH = (
    "No error map and no worst frames: they need every answer beside its truth, which {}."
)


@dataclass(frozen=True)
class Chapter:
    """key: of the protocol, for anchors. intro, published: HTML made of escaped text."""

    key: str
    title: str
    intro: str
    sections: tuple[Shown, ...]
    published: str
    runs: int


@dataclass(frozen=True)
class Shown:
    """A section: its tables as HTML, its figures, and why some are not there."""

    key: str
    title: str
    html: str
    panels: tuple[Panel, ...]
    lacking: tuple[str, ...]


def chapter(board: Board, sections: Sequence[Section], drawer: Drawer, cache: Path) -> Chapter:
    """The Markdown page of the same records is the text of the chapter."""
    keys = board.protocol.keys
    text = page(board.protocol, board.records, board.published, board.errors)
    first, *others = page_parts(text)
    published = [part for part in others if part.title == "Published"]
    measured = [part for part in others if part.title != "Published"]
    opened = Opened(board, drawer, cache)
    shown = [
        _shown(board, section, part, opened, k)
        for k, (section, part) in enumerate(zip(sections, measured, strict=True))
    ]
    return Chapter(
        keys.id,
        f"{keys.id}: {keys.title}",
        first.html,
        tuple(shown),
        "".join(part.html for part in published),
        len(board.records),
    )


def measured_sections(board: Board) -> list[Section]:
    """In the order of the page."""
    return sections_of(whole(board.records))


def _shown(board: Board, section: Section, part: Part, opened: Opened, k: int) -> Shown:
    rows = ordered(board.name, section.rows)
    looks = Looks([row for row in rows if not row.trivial])
    simulated = section.origin == "simulated"
    panels: list[Panel | None] = []
    if board.name in RANKING:
        panels.append(frontier_panel(rows, RANKING[board.name], looks))
    panels += distance_panels(rows, board.published, looks, simulated=simulated)
    maps, worst = error_maps(rows, opened.of), worst_frames(rows, opened)
    heat = relief(rows, board)
    lacking = []
    if maps is None:
        lacking.append(WITHOUT_TRUTH.format(opened.why(section.record)))
    if heat is None and board.protocol.keys.answer == "contacts" and k == 0:
        lacking.append(LACKING.format(board.name))
    made = tuple(panel for panel in (*panels, maps, worst, heat) if panel is not None)
    return Shown(_key(board.name, k), part.title, part.html, made, tuple(lacking))


def _key(name: str, number: int) -> str:
    return re.sub(r"[^a-z0-9-]", "-", f"{name}-{number}")
