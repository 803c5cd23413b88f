"""Answers beside the float32 ones, in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench import Contacts, PlatePose
from tactibench.run import Difference, compare, mean_error_mm


def at(*points: tuple[float, float, float]) -> Contacts:
    values = np.array(points, dtype=float).reshape(-1, 3)
    return Contacts(values[:, :2], values[:, 2], np.linspace(1, 0.5, len(values)))


def test_a_shift_is_the_distance():
    scored = [at((0, 0, 1)), at((3, 4, 2), (-3, 0, 2))]
    found = [at((0.3, 0.4, 1)), at((3, 4, 2.5), (-3, 0, 2.5))]
    gap = compare(found, scored)
    assert gap == Difference(0.5, 2, 0, None, largest_mm=0.5)
    assert gap.allowed


def test_contacts_in_another_order_are_the_same():
    one, other = at((3, 4, 2), (-3, 0, 2)), at((-3, 0, 2), (3, 4, 2))
    assert compare([one], [other]).median_mm == 0


def test_another_count_is_counted_not_measured():
    gap = compare([at(), at((0, 0, 1))], [at((0, 0, 1)), at((0, 0, 1))])
    assert gap == Difference(0.0, 2, 1, None, largest_mm=0.0)
    assert not gap.allowed
    assert not compare([None], [PlatePose(1.0, 0.0)]).allowed


def test_plates_and_nothing_at_all():
    assert compare([PlatePose(1.0, 2.0)], [PlatePose(1.25, 2.0)]).median_mm == 0.25
    assert compare([None], [None]) == Difference(None, 1, 0, None)
    assert compare([at()], [at()]) == Difference(None, 1, 0, None)
    assert compare([], []) == Difference(None, 0, 0, None)
    assert mean_error_mm([None, at()], [PlatePose(1, 0), at((0, 0, 1))]) is None
    assert mean_error_mm([PlatePose(1.0, 0)], [PlatePose(1.5, 0)]) == 0.5


def test_every_true_contact_is_looked_for():
    assert mean_error_mm([at((0, 0, 1))], [at((0, 0, 1), (3, 0, 1))]) == pytest.approx(1.5)


@given(st.floats(0.01, 1), st.floats(-0.5, 0.5))
def test_the_change_is_relative_to_float32(error, change):
    truth = [at((0, 0, 1))]
    gap = compare([at((error * (1 + change), 0, 1))], [at((error, 0, 1))], truth)
    assert gap.error_change == pytest.approx(change, abs=1e-9)
    if abs(abs(change) - 0.02) > 1e-6:
        assert gap.allowed is (abs(change) < 0.02)
    assert gap.as_row()["error_change"] == gap.error_change


def test_no_error_has_no_relative_change():
    assert compare([at((0, 0, 1))], [at((0, 0, 1))], [at((0, 0, 1))]).error_change is None
