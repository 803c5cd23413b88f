"""Tables of the report hold what the Markdown pages hold: cell by cell, in the same order."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from report_material import HOSTILE, hostile_record

pytest.importorskip("markdown_it", reason="the HTML report needs tactibench[report]")

from tactibench.board.boards import pages
from tactibench.board.html.tables import page_parts
from tactibench.board.page import page
from tactibench.protocols.loader import load_protocol

ROOT = Path(__file__).resolve().parents[2]
TAGS = {
    "p",
    "ul",
    "li",
    "em",
    "strong",
    "h3",
    "h4",
    "h5",
    "div",
    "table",
    "thead",
    "tbody",
    "tr",
    "th",
    "td",
    "br",
    "sub",
    "code",
    "pre",
    "details",
    "summary",
}
ATTRIBUTES = {"class", "role", "tabindex", "aria-label", "scope", "title", "data-v"}


class Reader(HTMLParser):
    """Cells as text, a table a list of rows; every tag and attribute that occurs."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.tables: list[list[list[str]]] = []
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.text = ""
        self._cell: list[str] | None = None

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("th", "td"):
            self._cell = []
        elif tag == "br" and self._cell is not None:
            self._cell.append("\n")

    def handle_endtag(self, tag):
        if tag in ("th", "td") and self._cell is not None:
            self.tables[-1][-1].append("".join(self._cell).strip())
            self._cell = None

    def handle_data(self, data):
        self.text += data
        if self._cell is not None:
            self._cell.append(data)


def read(html: str) -> Reader:
    reader = Reader()
    reader.feed(html)
    reader.close()
    return reader


def markdown_tables(text: str) -> list[list[list[str]]]:
    """Independent of the parser: lines that begin with a bar, split at bars, escapes undone."""
    found: list[list[list[str]]] = []
    before = ""
    for line in text.split("\n"):
        if line.startswith("| "):
            if not before.startswith("| "):
                found.append([])
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip()[1:-1])]
            if not all(re.fullmatch(r"-+:?", cell) for cell in cells):
                found[-1].append([shown(cell) for cell in cells])
        before = line
    return found


def shown(cell: str) -> str:
    cell = cell.replace("<br>", "\n").replace("<sub>", "").replace("</sub>", "")
    cell = re.sub(r"^`(.*)`$|^\*(.*)\*$", lambda m: m[1] or m[2], cell)
    return re.sub(r"\\(.)", r"\1", cell)


def all_html(text: str) -> str:
    return "".join(part.html for part in page_parts(text))


@pytest.mark.parametrize("made", pages(ROOT / "leaderboards"), ids=lambda made: made.path.stem)
def test_every_cell_is_that_of_the_markdown_page(made):
    found = read(all_html(made.text))
    wanted = markdown_tables(made.text)
    assert [len(table) for table in found.tables] == [len(table) for table in wanted]
    assert found.tables == wanted
    assert found.tags <= TAGS


@pytest.mark.parametrize("text", HOSTILE)
def test_a_name_brings_no_tag_and_no_attribute(fabricate, text):
    records = [hostile_record(fabricate, text), fabricate(model="cnn", encoder=None)]
    found = read(all_html(page(load_protocol("exp1"), records, [])))
    assert found.tags <= TAGS
    assert found.attributes <= ATTRIBUTES
    assert " ".join(text.split()) in found.text


def test_parts_are_named_as_their_headings(fabricate):
    text = page(load_protocol("exp1"), [fabricate(), fabricate(origin="real")], [])
    assert [part.title for part in page_parts(text)] == [
        "",
        "Simulated sensor tactip-127",
        "Real sensor tactip-127",
    ]
    assert "<h1>" not in all_html(text)


def test_numbers_sort_by_what_is_printed_and_words_do_not(fabricate):
    html = all_html(page(load_protocol("exp1"), [fabricate(error=0.0512)], []))
    assert 'class="n" data-v="0.0512">0.0512<br><sub>' in html
    assert '<td class="who">unet</td>' in html
    assert 'title="standard deviation over training seeds of MAE, mm"' in html


def test_markup_that_is_no_part_of_a_page_is_shown_as_text():
    html = all_html("## A\n\n<b>x</b> ![y](z) [link](javascript:a) <script>b</script>\n\n<div>c")
    assert read(html).tags <= {"p"}
    assert "&lt;script&gt;" in html
    assert "href" not in html
