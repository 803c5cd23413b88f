"""Named places: worked examples, groups and intervals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tactibench import Sites
from tactibench.errors import NotFiniteError
from tactibench.metrics import SiteTrials
from tactibench.metrics.registry import press_means, score
from tactibench.records import pack, unpack

NAMES = ("exact", "wrong_set", "told", "f1", "number_error", "brier")


def trials(*rows: tuple[str, str, tuple[float, ...], str], press: Any = None) -> SiteTrials:
    """Trials of (true places, predicted places, probabilities, group) over the places abc."""

    def sets(column: int) -> np.ndarray:
        return np.array([[name in row[column] for name in "abc"] for row in rows])

    names = np.arange(len(rows)) if press is None else np.array(press)
    probability = np.array([row[2] for row in rows])
    return SiteTrials(sets(0), sets(1), probability, names, tuple(row[3] for row in rows))


def values(tested: SiteTrials) -> dict[tuple[str, str], float | None]:
    rows = score(NAMES, tested, rng=np.random.default_rng(0))
    return {(row.metric, row.group): row.value for row in rows}


RIGHT = ("ab", "ab", (0.9, 0.8, 0.1), "2")
SHORT = ("ab", "a", (0.9, 0.4, 0.1), "2")
"""The number is wrong; the order of the places is right."""
OTHER = ("c", "b", (0.1, 0.6, 0.4), "1")


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (RIGHT, (1, 0, 1, 1, 0, (0.01 + 0.04 + 0.01) / 3)),
        (SHORT, (0, 1, 1, 0.5, 1, (0.01 + 0.36 + 0.01) / 3)),
        (OTHER, (0, 1, 0, 0, 0, (0.01 + 0.36 + 0.36) / 3)),
    ],
)
def test_worked_examples(row: Any, expected: tuple[float, ...]) -> None:
    found = values(trials(row))
    assert [found[name, "all"] for name in NAMES] == pytest.approx(list(expected))


def test_groups_are_numbers_of_places_and_tests_apart_follow() -> None:
    apart = [(*row[:3], f"session:{row[3]}") for row in (OTHER, RIGHT)]
    rows = score(["exact"], trials(RIGHT, SHORT, OTHER, *apart), rng=np.random.default_rng(0))
    assert [row.group for row in rows] == [
        *("1", "2", "all"),
        *("session:1", "session:2", "session"),
    ]
    assert [row.value for row in rows] == pytest.approx([0, 1 / 2, 1 / 3, 0, 1, 1 / 2])


def test_f1_is_a_mean_over_places_and_its_interval_holds_it() -> None:
    tested = trials(RIGHT, SHORT, RIGHT, SHORT, OTHER)
    (row,) = [r for r in score(["f1"], tested, rng=np.random.default_rng(0)) if r.group == "all"]
    # a: 4 hits; b: 2 hits, 2 missed, 1 false; c: 1 missed
    assert row.value == pytest.approx((1 + 4 / 7 + 0) / 3)
    assert row.low is not None
    assert row.high is not None
    assert row.low < row.value < row.high


def test_the_unit_of_an_interval_is_the_held_out_set() -> None:
    rows = [RIGHT, RIGHT, SHORT, SHORT]
    wide, narrow = (
        score(["exact"], trials(*rows, press=press), rng=np.random.default_rng(0))[0]
        for press in (["ab", "ab", "ac", "ac"], [0, 1, 2, 3])
    )
    assert (wide.clusters, narrow.clusters) == (2, 4)
    assert wide.high - wide.low > narrow.high - narrow.low


def test_rows_are_compared_unit_by_unit() -> None:
    means = press_means("wrong_set", trials(RIGHT, SHORT, OTHER, press=["x", "x", "y"]))
    assert means[:, 0] == pytest.approx([0.5, 1.0])


def test_answers_come_back_from_their_arrays() -> None:
    answers = (
        Sites(("left", "right"), (0.25, 1.0), (False, True)),
        Sites.truth(("left", "right"), (1, 1)),
    )
    assert unpack(pack(answers, "sites"), "sites") == answers
    assert (str(answers[0]), answers[1].count) == ("right", 2)
    assert str(Sites.truth(("left",), (0,))) == "nothing"


@pytest.mark.parametrize(
    ("probability", "error"),
    [((0.5, 1.5), ValueError), ((0.5, np.nan), NotFiniteError), ((0.5,), ValueError)],
)
def test_impossible_answers_are_refused(probability: tuple[float, ...], error: Any) -> None:
    with pytest.raises(error):
        Sites(("left", "right"), probability, (True, False))
