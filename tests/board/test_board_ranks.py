"""Rank groups: by pairing where answers are there, by intervals that are apart where not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench.board.grouping import rows_of
from tactibench.board.predictions import PressErrors
from tactibench.board.ranking import ranks
from tactibench.stats.intervals import mean_interval

PRESSES = np.array([f"p{k:03d}" for k in range(200)])


def records(fabricate, errors):
    """One record a model, its value and interval those of its errors."""
    made = []
    for name, values in errors.items():
        record = fabricate(model=name, encoder=None)
        found = mean_interval(values, np.arange(len(values)))
        row = next(m for m in record.metrics if m.metric == "mae_mm")
        row.value, row.low, row.high = found.value, found.low, found.high
        made.append(record)
    return made


def kept(made, errors):
    return {record.name: PressErrors(PRESSES, errors[record.model.name]) for record in made}


@pytest.fixture
def errors():
    """Presses differ much more than models do; b is only told from a by pairing."""
    rng = np.random.default_rng(0)
    hard = rng.gamma(2, 1, 200)
    return {"a": hard, "b": hard + 0.1 + rng.normal(0, 0.05, 200), "c": hard + 9.0}


def by_model(found, rows):
    return {row.model: rank for row, rank in zip(rows, found.by_row, strict=True)}


def test_pairing_tells_apart_what_overlapping_intervals_do_not(fabricate, errors) -> None:
    made = records(fabricate, errors)
    rows = rows_of(made)
    paired = ranks("exp1", rows, kept(made, errors))
    assert by_model(paired, rows) == {"a": 1, "b": 2, "c": 3}
    assert paired.note == ""
    alone = ranks("exp1", rows, {})
    assert by_model(alone, rows) == {"a": 1, "b": 1, "c": 3}
    assert "No row has answers beside all records" in alone.note
    some = ranks("exp1", rows, dict(list(kept(made, errors).items())[:1]))
    assert "2 of 3 rows do not have answers" in some.note


def test_seeds_are_averaged_press_by_press(fabricate, errors) -> None:
    """Two seeds whose errors swap are as good as one that has their mean."""
    first, second = fabricate(model="a", encoder=None), fabricate(model="a", encoder=None, seed=1)
    one = fabricate(model="b", encoder=None)
    swing = np.where(np.arange(200) % 2, 1.0, -1.0)
    known = {
        first.name: PressErrors(PRESSES, errors["a"] + swing),
        second.name: PressErrors(PRESSES, errors["a"] - swing),
        one.name: PressErrors(PRESSES, errors["a"]),
    }
    rows = rows_of([first, second, one])
    assert ranks("exp1", rows, known).by_row == (1, 1)
    del known[second.name]
    assert ranks("exp1", rows, known).paired == 1


def test_a_row_without_the_error_and_a_protocol_without_an_order(fabricate) -> None:
    rows = rows_of([fabricate(), fabricate(model="cnn", error=None)])
    assert by_model(ranks("exp1", rows, {}), rows) == {"unet": 1, "cnn": None}
    assert ranks("unordered", rows, {}) is None


@given(st.integers(0, 10_000), st.floats(-0.9, 0.99), st.floats(0, 1))
def test_intervals_that_are_apart_are_told_apart_by_pairing(seed, correlation, shift) -> None:
    """The claim behind the fallback, for any correlation of the two models."""
    rng = np.random.default_rng(seed)
    common, own = rng.normal(size=(2, 30))
    a = common
    b = shift * 2 + correlation * common + np.sqrt(1 - correlation**2) * own
    first, second = (mean_interval(x, np.arange(30)) for x in (a, b))
    if second.low > first.high:
        assert mean_interval(b - a, np.arange(30)).low > 0


def test_a_row_with_errors_of_few_presses_is_not_paired(fabricate, errors) -> None:
    """It could choose the presses that it is compared on."""
    made = records(fabricate, errors)
    rows = rows_of(made)
    known = kept(made, errors)
    (b,) = [record for record in made if record.model.name == "b"]
    for count, rank in ((199, 2), (100, 1), (0, 1)):
        known[b.name] = PressErrors(PRESSES[:count], errors["b"][:count])
        assert by_model(ranks("exp1", rows, known), rows)["b"] == rank
    known[b.name] = PressErrors(np.array([f"q{k:03d}" for k in range(200)]), errors["b"])
    assert by_model(ranks("exp1", rows, known), rows)["b"] == 1


def test_a_row_without_presses_and_without_an_interval_has_no_rank(fabricate, errors) -> None:
    made = records(fabricate, errors)
    row = next(m for m in made[1].metrics if m.metric == "mae_mm")
    row.low = row.high = None
    rows = rows_of(made)
    assert by_model(ranks("exp1", rows, {}), rows) == {"a": 1, "b": None, "c": 2}
