"""Ratios of means over the same presses, and where along an axis they reach two."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench.stats import Estimate, crossing, doubling, mean_ratio

PRESS = np.arange(50)


def ratio(value: float | None, half: float = 0.0) -> Estimate:
    ends = (None, None) if value is None else (value - half, value + half)
    return Estimate(value, *ends, 50, 50)


def test_a_ratio_is_that_of_the_means() -> None:
    a, b = np.linspace(1, 3, 50), np.linspace(0.5, 1.5, 50)
    found = mean_ratio(a, PRESS, b, PRESS)
    assert found.value == pytest.approx(2)
    assert (found.n, found.clusters) == (50, 50)


def test_pairs_that_rise_together_have_no_spread() -> None:
    """a = 2 b press by press: the ratio is known exactly, however much b varies."""
    b = np.exp(np.random.default_rng(1).normal(0, 1, 50))
    found = mean_ratio(2 * b, PRESS, b, PRESS)
    assert (found.low, found.high) == pytest.approx((2, 2))
    apart = mean_ratio(2 * b, PRESS, b, PRESS + 50)
    assert apart.low is not None
    assert apart.low < 1.8


def test_what_cannot_be_said_is_not() -> None:
    one = np.ones(3)
    assert mean_ratio(one, PRESS[:3], np.zeros(3), PRESS[:3]).value is None
    assert mean_ratio([], [], one, PRESS[:3]).value is None
    nothing = mean_ratio(np.zeros(3), PRESS[:3], one, PRESS[:3])
    assert (nothing.value, nothing.low, nothing.high) == (0.0, None, None)
    alone = mean_ratio([2.0], [0], [1.0], [0])
    assert (alone.value, alone.low) == (2.0, None)
    rare = mean_ratio([1.0, 0.0], [0, 1], [0.0, 1.0], [0, 1])  # two presses: t is 12.7
    assert (rare.value, rare.high) == (1.0, pytest.approx(np.exp(2 * 12.7062), rel=1e-3))
    with pytest.raises(ValueError, match="1 of 2 values are not finite"):
        mean_ratio([1.0, np.nan], [0, 1], [1.0, 1.0], [0, 1])


@pytest.mark.parametrize(
    ("values", "ratios", "expected"),
    [
        ([0, 1, 2], [1, 1.5, 2.5], 1.5),  # half way between 1 and 2
        ([2.0, 0.5, 0.3], [1, 3, 9], 1.25),  # falling: half way between 2.0 and 0.5
        ([0, 1, 2, 3], [1, 2, 1, 5], 1),  # reached on a value, and the first time counts
        ([0, 1], [1, 1.99], None),
        ([0, 1, 2], [1, None, 9], None),  # unknown before it is reached
        ([0, 1, 2], [1, 3, None], 0.5),
        ([0, 1], [2.5, 9], 0),  # an upper end that lies above from the start
    ],
)
def test_crossings_of_hand_made_curves(values, ratios, expected) -> None:  # type: ignore[no-untyped-def]
    found = crossing(values, ratios)
    assert found == (None if expected is None else pytest.approx(expected))


def test_doubling_rising_with_its_interval() -> None:
    found = doubling(0.0, (1.0, 2.0), [ratio(1.5, 0.5), ratio(2.5, 0.5)])
    assert found.value == pytest.approx(1.5)
    assert (found.low, found.high) == pytest.approx((1.0, 2.0))
    assert (found.n, found.clusters, found.censored) == (50, 50, None)


@pytest.mark.parametrize(("values", "sign"), [((1.0, 2.0), ">"), ((-1.0, -2.0), "<")])
def test_what_is_not_reached_is_said(values: tuple[float, ...], sign: str) -> None:
    found = doubling(0.0, values, [ratio(1.0), ratio(1.9, 0.2)])
    assert (found.value, found.censored) == (values[-1], sign)
    ends = sorted(end for end in (found.low, found.high) if end is not None)
    assert len(ends) == 1  # where the upper ends reach two
    assert abs(ends[0]) < 2


def test_an_unknown_ratio_leaves_no_doubling_point() -> None:
    assert doubling(0.0, (1.0, 2.0), [ratio(None), ratio(5)]).value is None
    assert doubling(0.0, (), []).value is None


@given(
    st.lists(st.floats(0.1, 5), min_size=1, max_size=8),
    st.lists(st.tuples(st.floats(0.1, 9), st.floats(0, 1)), min_size=8, max_size=8),
    st.booleans(),
)
def test_the_interval_holds_the_point_and_the_axis_both(
    steps: list[float], ratios: list[tuple[float, float]], rising: bool
) -> None:
    values = np.cumsum(steps) if rising else -np.cumsum(steps)
    known = [Estimate(r, r * (1 - w / 2), r * (1 + w), 9, 9) for r, w in ratios[: len(steps)]]
    found = doubling(0.0, tuple(values.tolist()), known)
    assert found.value is not None
    low, high = sorted((0.0, float(values[-1])))
    assert low <= found.value <= high
    assert found.low is None or found.low <= found.value + 1e-9
    assert found.high is None or found.high >= found.value - 1e-9
