"""Text of strangers: what stands in a script, in a figure and in a cell is only ever text."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_material import HOSTILE

from tactibench.board.html.inert import figure_text, script_json
from tactibench.board.html.sorting import sort_value

ANY = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)


@given(ANY)
def test_json_in_a_script_is_the_same_value_and_holds_no_markup(value):
    text = script_json(value)
    assert json.loads(text) == value
    assert not set(text) & set("<>&\u2028\u2029")


@pytest.mark.parametrize("text", HOSTILE)
def test_json_of_hostile_names(text):
    made = script_json({"name": text})
    assert "<" not in made
    assert json.loads(made) == {"name": text}


def test_json_refuses_what_is_no_number():
    with pytest.raises(ValueError, match="not JSON compliant"):
        script_json([float("nan")])


@given(st.text())
def test_a_label_of_a_figure_has_no_markup_of_its_own(text):
    made = figure_text(text)
    assert not set(made) & set("<>\n")
    assert "$" not in made.replace("\u200b$", "")
    assert made.replace("&lt;", "").replace("&gt;", "").replace("&amp;", "").count("&") == 0


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.0500", 0.05),
        ("1,234.5", 1234.5),
        ("< 6.50", 6.5),
        ("> 12.00", 12.0),
        ("4e-05", 4e-5),
        ("-0.031", -0.031),
        ("1.93 M", 1.93e6),
        ("12.3 k", 12300.0),
        ("2.1 G", 2.1e9),
        ("38 s", 38.0),
        ("4 min 5 s", 245.0),
        ("1 h 2 min", 3720.0),
        ("0.4 s", 0.4),
        ("1 seed", 1.0),
        ("3", 3.0),
        ("3.00*", 3.0),
        ("n/a", None),
        ("no", None),
        ("", None),
        ("tactip-127", None),
        ("open", None),
        ("100.0", 100.0),
        ("0", 0.0),
    ],
)
def test_a_cell_sorts_by_the_number_that_is_printed(text, value):
    assert sort_value(text) == (None if value is None else pytest.approx(value))


@given(st.floats(-1e6, 1e6), st.integers(0, 5))
def test_any_fixed_number_sorts_as_itself(value, decimals):
    text = f"{value:,.{decimals}f}"
    assert sort_value(text) == float(text.replace(",", ""))
