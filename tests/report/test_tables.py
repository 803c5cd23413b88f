"""One table in three forms: the same facts, and no text of a stranger ever markup."""

from __future__ import annotations

import re
from html import unescape
from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_material import HOSTILE

from tactibench.report import (
    Column,
    Number,
    Table,
    Text,
    code,
    duration,
    escape,
    fixed,
    prose_html,
    prose_markdown,
    significant,
    table,
    table_lines,
    terminal_text,
)

CELLS = {
    "number": (Number(0.0512, fixed(3)), "0.051", "0.051"),
    "interval": (
        Number(0.412, fixed(3), (0.398, 0.426)),
        "0.412<br><sub>0.398 – 0.426</sub>",
        "0.412 [0.398, 0.426]",
    ),
    "open": (
        Number(0.412, fixed(3), (None, 0.426)),
        "0.412<br><sub>open – 0.426</sub>",
        "0.412 [open, 0.426]",
    ),
    "bound": (Number(6.5, fixed(1), (6.0, 7.0), "<"), "&lt; 6.5", "< 6.5"),
    "below": (Number(1.25, fixed(2), below="50 %"), "1.25<br><sub>50 %</sub>", "1.25 50 %"),
    "mark": (Number(3.0, fixed(2), mark="*"), r"3.00\*", "3.00*"),
    "time": (Number(245.0, duration), "4 min 5 s", "4 min 5 s"),
    "italic": (Text("mean", "italic"), "*mean*", "mean"),
    "code": (Text("0123", "code"), "`0123`", "0123"),
    "missing": (None, "n/a", "n/a"),
}


@pytest.mark.parametrize("name", CELLS)
def test_a_cell_on_a_page_and_on_a_terminal(name):
    cell, markdown, terminal = CELLS[name]
    one = table([Column("head")], [[cell]])
    assert table_lines(one) == ["| head |", "| ---: |", f"| {markdown} |"]
    assert terminal_text(one, 80).plain.split("\n")[1].strip() == terminal


@pytest.mark.parametrize(
    ("write", "value", "text"),
    [
        (fixed(3), 0.0003, "3e-04"),
        (fixed(3), 0.0, "0.000"),
        (fixed(1), 1234.5, "1,234.5"),
        (fixed(1), -0.2, "-0.2"),
        (significant, 0.01234, "0.0123"),
        (significant, 1234.0, "1,234"),
        (significant, 0.0, "0"),
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


WIDE = Table(
    (Column("model", right=False), *map(Column, ("first error, mm", "second", "third"))),
    tuple((f"model number {k} with its {k} settings", "1.0", "2.0", "3.0") for k in range(2)),
)


@given(st.integers(40, 120))
def test_a_table_fits_the_terminal_and_names_what_it_leaves_out(width):
    lines = terminal_text(WIDE, width).plain.split("\n")
    assert max(map(len, lines)) <= width
    text = "\n".join(lines)
    assert all(word in text for word in ("number 0", "number 1", "1.0", "second", "third"))
    assert ("too wide for this terminal: " in text) == ("3.0" not in text)


def test_a_table_that_is_not_on_a_terminal_has_all_its_columns():
    text = terminal_text(WIDE).plain
    assert "model number 0 with its 0 settings  " in text
    assert "third" in text.split("\n")[0]


def unescaped(text):
    return unescape(re.sub(r"\\(.)", r"\1", text))


@given(st.text())
def test_escaped_markdown_is_one_line_without_markup_and_reads_as_before(text):
    safe = escape(text)
    assert "\n" not in safe
    assert unescaped(safe) == " ".join(text.split())
    assert not re.search(r"(?<!\\)(?:\\\\)*[`*_\[\]<>|]", safe)


@given(st.text())
def test_code_and_prose_cannot_be_left(text):
    assert code(text).count("`") == 2
    assert "|" not in code(text)
    prose = prose_markdown(text)
    assert "\n" not in prose
    assert not re.search(r"(?<!\\)(?:\\\\)*[*_\[\]<>|]", re.sub("`[^`]*`", "", prose))
    tags: set[str] = set()
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, _: tags.add(tag)  # type: ignore[method-assign]
    parser.feed(prose_html(text))
    assert tags <= {"code"}


@pytest.mark.parametrize("text", HOSTILE)
def test_text_of_strangers_stays_in_its_cell(text):
    lines = table_lines(table([text], [[Text(text, "italic", text)], [Text(text, "code")]]))
    assert all(len(re.findall(r"(?<!\\)\|", line)) == 2 for line in lines)
    assert "<img" not in "".join(lines[:3]).replace(r"\<img", "")
