"""Factors that make stated standard deviations honest."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench import Contacts
from tactibench_mixture.calibration import std_factors

STD = np.array([0.1, 0.2, 0.05])


def answers(seed, frames, factors, count=1):
    """Contacts whose errors are ``factors`` times as large as stated."""
    rng = np.random.default_rng(seed)
    found, truth = [], []
    for _ in range(frames):
        xy = np.column_stack([np.arange(count) * 8.0 - 4, rng.uniform(-5, 5, count)])
        true = Contacts.truth(xy, rng.uniform(1, 6, count))
        error = rng.normal(0, 1, (count, 3)) * STD * factors
        std = np.tile(STD, (count, 1))
        turned = slice(None, None, -1)  # in another order than the truth
        xy, depth = (xy + error[:, :2])[turned], (true.depth + error[:, 2])[turned]
        found.append(Contacts(xy, depth, np.ones(count), std))
        truth.append(true)
    return found, truth


def test_the_factors_are_those_of_the_errors():
    factors = np.array([2.0, 0.5, 3.0])
    found = std_factors(*answers(1, 20_000, factors))
    np.testing.assert_allclose(found[0], factors, rtol=0.03)
    assert np.array_equal(found[0], found[1])


def test_95_percent_lie_inside_whatever_the_distribution():
    rng = np.random.default_rng(2)
    truth = [Contacts.truth([[0, 0]], [1])] * 500
    errors = rng.standard_t(2, (500, 3))
    found = [Contacts([e[:2]], [1 + e[2]], [1], [STD]) for e in errors]
    z = errors / (STD * std_factors(found, truth)[0])
    assert np.mean(np.hypot(z[:, 0], z[:, 1]) ** 2 <= -2 * np.log(0.05)) == pytest.approx(0.95)
    assert np.mean(np.abs(z[:, 2]) <= 1.96) == pytest.approx(0.95, abs=0.003)


def test_frames_with_several_contacts_have_factors_of_their_own():
    one, two = answers(3, 3000, np.ones(3)), answers(4, 3000, np.full(3, 2.0), count=2)
    found = std_factors(one[0] + two[0], one[1] + two[1])
    np.testing.assert_allclose(found[0], 1.0, rtol=0.06)
    np.testing.assert_allclose(found[1], 2.0, rtol=0.06)


def test_too_few_contacts_leave_the_std_as_it_is():
    assert (std_factors(*answers(5, 19, np.full(3, 4.0))) == 1).all()
    assert (std_factors([], []) == 1).all()


def test_frames_in_which_the_count_is_wrong_are_left_out():
    found, truth = answers(6, 500, np.ones(3))
    expected = std_factors(found, truth)
    wrong = [*answers(7, 50, np.full(3, 50.0), count=2)[0], *[Contacts.none()] * 50]
    more = std_factors([*found, *wrong], [*truth, *truth[:100]])
    assert np.array_equal(more, expected)


def test_contacts_without_std_are_left_out():
    found, truth = answers(8, 30, np.full(3, 2.0))
    silent = [Contacts(one.xy, one.depth, one.score) for one in found]
    assert (std_factors(silent, truth) == 1).all()
