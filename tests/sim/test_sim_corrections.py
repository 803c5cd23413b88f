"""Corrections for the rim and for pairs: parity, and the look-up of a patch against scipy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from tactibench_sim import Corrections, look_up, pair_amounts, shipped_dome

TABLES = shipped_dome()
STEP, START, ALONG, ACROSS = math.radians(5), -10 * math.radians(5), 21, 11
GRID = np.random.default_rng(3).normal(size=(ALONG + 2, ACROSS + 2, 6))


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.01, math.radians(40)),
    st.floats(0.01, 3.1) | st.floats(-3.1, -0.01),
    st.integers(0, 100),
)
def test_a_patch_is_the_tensor_spline_of_lamberts_chart(r, azimuth, seed):
    """In any frame. What lies at b < 0 is the mirror image: components along f change sign."""
    frame = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    at = np.array([math.sin(r) * math.cos(azimuth), math.sin(r) * math.sin(azimuth), math.cos(r)])
    chord = 2 * math.sin(r / 2)
    a, b = chord * math.cos(azimuth), chord * math.sin(azimuth)
    knots = [START + STEP * np.arange(-3, ALONG + 3), STEP * np.arange(-3, ACROSS + 3)]
    over_a = BSpline(knots[0], GRID, 3)(a)
    told = BSpline(knots[1], over_a, 3)(abs(b)) * np.where(b < 0, [1, -1, 1, 1, -1, 1], 1)
    found = np.array(look_up(GRID, STEP, START, frame, *(at @ frame)))
    assert found == pytest.approx(told, abs=1e-9)


@pytest.mark.parametrize("where", ["base", "skin"])
def test_pair_modes_are_exactly_even_or_odd(where):
    """Exchanging the contacts mirrors a: the even modes stay, the odd ones turn over."""
    modes = TABLES.corrections.pairs(where, (3.0,)).modes.grid
    even = TABLES.corrections.grid["pair_even"]
    other = modes[:, ::-1] * np.array([-1.0, 1.0, 1.0] * 2)
    assert (modes[:even] == other[:even]).all()
    assert (modes[even:] == -other[even:]).all()


@given(st.floats(0.05, 1.0), st.floats(0.1, 6.4), st.floats(0.1, 6.4))
def test_pair_amounts_have_the_parity_of_their_modes(angle, first, second):
    pairs = TABLES.corrections.pairs("base", (3.0,))
    even = TABLES.corrections.grid["pair_even"]
    one, other = np.empty(pairs.amounts.shape[-1]), np.empty(pairs.amounts.shape[-1])
    pair_amounts(pairs, angle, first, second, one)
    pair_amounts(pairs, angle, second, first, other)
    assert one[:even] == pytest.approx(other[:even], abs=1e-12)
    assert one[even:] == pytest.approx(-other[even:], abs=1e-12)


def test_nothing_is_corrected_where_nothing_was_learned():
    none = Corrections({}, {})
    assert (none.around("base", (3.0,)).amounts == 0).all()
    assert none.pairs("base", (3.0,)).indenter == -1
    known = TABLES.corrections.around("base", (2.0, 3.0))
    assert (known.amounts[0] == 0).all()
    assert (known.amounts[1] != 0).any()
