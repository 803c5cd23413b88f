"""Tables of a page: what holds no value goes, and nothing that holds one does."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from tactibench.report import (
    Column,
    Group,
    Number,
    Text,
    compact,
    compact_blocks,
    fixed,
    named_briefly,
    prose,
)
from tactibench.report.table import table
from tactibench.report.writers.html import html

WHO = Column("model", who=True)
REGIME = Column("regime", detail=True)


WRITE = fixed(2)


def number(value: float) -> Number:
    return Number(value, WRITE)


def name(text: str) -> Text:
    return Text(text, below="single, 3 seeds")


def test_columns_and_rows_without_a_value_go_and_are_counted():
    rows = [[name("a"), "single", number(1), None], [name("b"), "single", None, None]]
    shown = compact(table([WHO, REGIME, Column("error"), Column("none")], rows, note="Note."))
    assert shown is not None
    assert [column.head for column in shown.columns] == ["model", "error"]
    assert [row[0] for row in shown.rows] == [name("a")]
    assert shown.note == "Note. 1 row without a value not shown."


def test_a_table_of_nothing_goes_and_its_group_stays_in_order():
    nothing = table([WHO, REGIME, Column("error")], [[name("a"), "single", None]])
    full = table([WHO, Column("error")], [["a", number(1)]])
    words = prose("words")
    kept = compact_blocks([nothing, words, Group("group", (nothing, full))])
    assert kept == [words, Group("group", (full,))]


def test_a_spread_stands_below_its_value():
    heads = [WHO, Column("error"), Column("sd", spread=True), Column("other")]
    shown = compact(table(heads, [[name("a"), number(1), number(0.25), number(2)]]))
    assert shown is not None
    assert [column.head for column in shown.columns] == ["model", "error", "other"]
    assert shown.rows[0][1] == replace(number(1), below="sd 0.25")


def test_details_stay_where_the_name_does_not_say_them():
    shown = compact(table([WHO, REGIME, Column("error")], [["a", "single", number(1)]]))
    assert shown is not None
    assert [column.head for column in shown.columns] == ["model", "regime", "error"]


def test_what_all_rows_say_stands_below_once():
    heads = [WHO, Column("machine", right=False), Column("error")]
    shown = compact(table(heads, [[name(n), "abc", number(1)] for n in "ab"]))
    assert shown is not None
    assert [column.head for column in shown.columns] == ["model", "error"]  # equal numbers stay
    assert shown.note == "In all rows: machine: abc."
    one = compact(table(heads, [[name("a"), "abc", number(1)]]))
    assert one is not None
    assert len(one.columns) == 3


def test_details_are_hidden_where_names_tell_rows_apart():
    apart, alike = (table([WHO], [[name(n)] for n in names]) for names in ("ab", "aa"))
    brief, same = named_briefly([Group("group", (apart,)), alike])
    assert isinstance(brief, Group)
    (shown,) = brief.blocks
    assert 'data-more="single, 3 seeds"' in html([shown])
    assert "<sub>" not in html([shown])
    assert same == alike


def test_links_stay_with_their_rows():
    rows = [[name("a"), None], [name("b"), number(1)]]
    made = replace(table([WHO, Column("error")], rows), anchors=("row-a", "row-b"))
    shown = compact(made)
    assert shown is not None
    assert shown.anchors == ("row-b",)


CELLS = st.one_of(st.none(), st.floats(-9, 9).map(number))


@given(st.integers(1, 5).flatmap(lambda n: st.lists(st.lists(CELLS, min_size=n, max_size=n))))
def test_every_value_is_kept_once(cells: list[list[Number | None]]):
    width = len(cells[0]) if cells else 1
    heads = [WHO, *(Column(str(k)) for k in range(width))]
    made = table(heads, [[name(str(k)), *row] for k, row in enumerate(cells)])
    shown = compact(made)
    values = [cell for row in cells for cell in row if cell is not None]
    if shown is None:
        assert not values
        return
    assert [c for row in shown.rows for c in row[1:] if c is not None] == values
    assert all(any(cell is not None for cell in row[1:]) for row in shown.rows)
    assert all(any(row[k] is not None for row in shown.rows) for k in range(len(shown.columns)))
