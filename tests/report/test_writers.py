"""One table in five formats: the same facts, and no text of a stranger ever markup."""

from __future__ import annotations

import csv
import io
import re
from html import unescape
from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_material import HOSTILE

from tactibench.report import (
    Bullets,
    Caption,
    Column,
    Fold,
    Heading,
    Number,
    Paragraph,
    Prose,
    Table,
    Text,
    code,
    csv_text,
    duration,
    escape,
    fixed,
    latex_text,
    markdown,
    number,
    numbers,
    significant,
    table_html,
    table_lines,
    terminal_text,
)
from tactibench.report.table import table
from tactibench.report.writers.html import html

CELLS = {
    "number": Number(0.0512, fixed(3)),
    "interval": Number(0.412, fixed(3), (0.398, 0.426)),
    "open": Number(0.412, fixed(3), (None, 0.426)),
    "bound": Number(6.5, fixed(1), (6.0, 7.0), "<"),
    "below": Number(1.25, fixed(2), below="50 %"),
    "mark": Number(3.0, fixed(2), mark="*"),
    "large": Number(1_930_000, numbers.scaled),
    "time": Number(245.0, duration),
    "italic": Text("mean", "italic"),
    "code": Text("0123", "code"),
    "missing": None,
}
MARKDOWN = {
    "number": "0.051",
    "interval": "0.412<br><sub>0.398 – 0.426</sub>",
    "open": "0.412<br><sub>open – 0.426</sub>",
    "bound": "&lt; 6.5",
    "below": "1.25<br><sub>50 %</sub>",
    "mark": r"3.00\*",
    "large": "1.93 M",
    "time": "4 min 5 s",
    "italic": "*mean*",
    "code": "`0123`",
    "missing": "n/a",
}
HTML = {
    "number": ' data-v="0.0512">0.051<',
    "interval": ' data-v="0.412">0.412<br><sub>0.398 – 0.426</sub><',
    "open": ' data-v="0.412">0.412<br><sub>open – 0.426</sub><',
    "bound": ' data-v="6.5">&lt; 6.5<',
    "below": ' data-v="1.25">1.25<br><sub>50 %</sub><',
    "mark": ' data-v="3">3.00*<',
    "large": ' data-v="1930000">1.93 M<',
    "time": ' data-v="245">4 min 5 s<',
    "italic": "><em>mean</em><",
    "code": "><code>0123</code><",
    "missing": '><span class="na">n/a</span><',
}
TERMINAL = {
    "number": "0.051",
    "interval": "0.412 [0.398, 0.426]",
    "open": "0.412 [open, 0.426]",
    "bound": "< 6.5",
    "below": "1.25 50 %",
    "mark": "3.00*",
    "large": "1.93 M",
    "time": "4 min 5 s",
    "italic": "mean",
    "code": "0123",
    "missing": "n/a",
}
LATEX = {
    "number": "0.051",
    "interval": r"0.412 {\scriptsize [0.398, 0.426]}",
    "open": r"0.412 {\scriptsize [open, 0.426]}",
    "bound": r"\textless{} 6.5",
    "below": "1.25",
    "italic": r"\textit{mean}",
    "code": r"\texttt{0123}",
    "missing": "--",
}
VALUES = {"number": "0.0512", "bound": "6.5", "time": "245.0", "italic": "mean", "missing": ""}


def one(cell) -> Table:
    return table([Column("head")], [[cell]], title="title")


@pytest.mark.parametrize("name", CELLS)
def test_a_cell_in_markdown(name):
    assert table_lines(one(CELLS[name])) == ["| head |", "| ---: |", f"| {MARKDOWN[name]} |"]


@pytest.mark.parametrize("name", CELLS)
def test_a_cell_in_html_sorts_by_its_value(name):
    assert f'<td class="n"{HTML[name]}/td>' in table_html(one(CELLS[name]))


@pytest.mark.parametrize("name", CELLS)
def test_a_cell_in_a_terminal(name):
    assert terminal_text(one(CELLS[name]), 80).plain.split("\n")[1].strip() == TERMINAL[name]


@pytest.mark.parametrize("name", LATEX)
def test_a_cell_in_latex(name):
    assert f"\n{LATEX[name]} \\\\\n" in latex_text(one(CELLS[name]))


@pytest.mark.parametrize("name", VALUES)
def test_a_cell_in_csv_is_its_value(name):
    lines = list(csv.reader(io.StringIO(csv_text(one(CELLS[name])))))
    assert lines == [["head"], [VALUES[name]]]


def test_words_stand_to_the_left_and_numbers_to_the_right():
    shown = table(["a", Column("b")], [["1", "2"]])
    assert table_lines(shown) == ["| a | b |", "| --- | ---: |", "| 1 | 2 |"]
    assert r"\begin{tabular}{lr}" in latex_text(shown)
    assert '<th scope="col">a</th><th scope="col" class="n">b</th>' in table_html(shown)


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [(0.0003, 3, "3e-04"), (0.0, 3, "0.000"), (1234.5, 1, "1,234.5"), (-0.2, 1, "-0.2")],
)
def test_small_values_do_not_become_zero(value, decimals, text):
    assert number(value, decimals) == text


@pytest.mark.parametrize(
    ("write", "value", "text"),
    [
        (significant, 0.01234, "0.0123"),
        (significant, 1234.0, "1,234"),
        (significant, 0.0, "0"),
        (numbers.scaled, 950.0, "950"),
        (numbers.scaled, 2.1e9, "2.1 G"),
        (numbers.general, 0.2149, "0.215"),
        (duration, 0.44, "0.4 s"),
        (duration, 38.0, "38 s"),
        (duration, 3720.0, "1 h 2 min"),
    ],
)
def test_numbers_as_text(write, value, text):
    assert write(value) == text


def test_values_stand_under_each_other_whatever_follows_them():
    cells = [Number(9.5, fixed(1), (9.0, 10.0)), Number(12.0, fixed(1), (11.0, 13.0)), None]
    shown = Table((Column("", right=False),), tuple((cell,) for cell in cells))
    assert terminal_text(shown, 80).plain.split("\n") == [
        " 9.5 [9.0, 10.0]",
        "12.0 [11.0, 13.0]",
        " n/a",
    ]


def test_a_narrow_terminal_loses_optional_columns_and_says_their_numbers():
    columns = (Column("name", right=False), Column("n", optional=True))
    captions = {0: (Caption("measured"), Caption("", narrow="n 5"))}
    shown = Table(columns, (("x" * 10, "5"),), captions=captions)
    assert terminal_text(shown, 80).plain.split("\n")[1:] == ["measured", f"{'x' * 10}  5"]
    assert terminal_text(shown, 11).plain.split("\n") == [
        "name",
        "measured",
        "n 5",
        "x" * 10,
    ]


def unescaped(text):
    return unescape(re.sub(r"\\(.)", r"\1", text))


@given(st.text())
def test_escaped_markdown_is_one_line_without_markup_and_reads_as_before(text):
    safe = escape(text)
    assert "\n" not in safe
    assert unescaped(safe) == " ".join(text.split())
    assert not re.search(r"(?<!\\)(?:\\\\)*[`*_\[\]<>|]", safe)


@given(st.text())
def test_code_and_folds_cannot_be_left(text):
    assert code(text).count("`") == 2
    assert "|" not in code(text)
    lines = markdown([Fold("s", (text,))]).split("\n")
    assert [line for line in lines if line.startswith("```")] == ["```text", "```"]


class Reader(HTMLParser):
    """Tags and attributes that occur, and the text between them."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_data(self, data):
        self.text += data


@pytest.mark.parametrize("text", HOSTILE)
def test_text_of_strangers_brings_no_tag_and_no_attribute(text):
    shown = Table((Column(text, title=text),), ((Text(text, "italic"),), (text,)), title=text)
    blocks = (
        Heading(2, text),
        Paragraph((Prose("see `this`: "), text, Text(text, "italic"), Text(text, "code"))),
        Bullets(((text,),)),
        Fold("lines", (text,)),
        shown,
    )
    page = Reader(html(blocks))
    assert page.tags <= {
        *("h3", "h4", "p", "em", "code", "ul", "li", "details", "summary", "pre"),
        *("div", "table", "thead", "tbody", "tr", "th", "td"),
    }
    assert page.attributes <= {"class", "role", "tabindex", "aria-label", "scope", "title"}
    assert page.text.count(text) >= 8
    written = re.sub(r"`[^`]*`", "", markdown((blocks[0], blocks[2])))
    assert "<img" not in written.replace(r"\<img", "")


@pytest.mark.parametrize("text", HOSTILE)
def test_latex_prints_text_as_it_is(text):
    body = latex_text(one(Text(text))).split(r"\midrule")[1].split(r"\bottomrule")[0]
    assert not re.search(r"(?<!\\)[$%&#_]", body.replace(r"\\", ""))


def test_a_cell_that_a_spreadsheet_would_compute_is_text():
    assert csv_text(table(["a"], [["=1+1"]])) == "a\n'=1+1\n"
