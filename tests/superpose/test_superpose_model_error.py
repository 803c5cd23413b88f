"""What fields that add up leave of several contacts, learned and made independent."""

import numpy as np
import pytest

from tactibench_superpose import FEWEST, ModelError

PINS = 12
WEIGHT = np.random.default_rng(0).uniform(1e4, 1e5, 2 * PINS)


def drawn(count, seed=1):
    """(count, 24) px: three usual patterns, and noise of the weight's deviation."""
    rng = np.random.default_rng(seed)
    patterns = np.random.default_rng(2).normal(size=(3, 2 * PINS))
    noise = rng.normal(size=(count, 2 * PINS)) / np.sqrt(WEIGHT)
    return 0.1 * rng.normal(size=(count, 3)) @ patterns + noise


@pytest.fixture(scope="module")
def learned():
    return ModelError.learn(drawn(4000), WEIGHT)


@pytest.mark.parametrize("lost", [(), (0,), (1, 5, 11)], ids=str)
def test_the_whitener_makes_unseen_presses_independent(learned, lost):
    sure = np.ones(PINS, dtype=bool)
    sure[list(lost)] = False
    whitener = learned.whitener(sure)
    assert whitener.shape == (2 * PINS, 2 * (PINS - len(lost)))
    made = drawn(4000, seed=3) @ whitener
    np.testing.assert_allclose(made.T @ made / len(made), np.eye(made.shape[1]), atol=0.15)


def test_pins_that_are_not_sure_have_no_say(learned):
    sure = np.ones(PINS, dtype=bool)
    sure[4] = False
    left = drawn(1)[0]
    other = left.copy()
    other[[4, 4 + PINS]] = 1e6
    whitener = learned.whitener(sure)
    np.testing.assert_allclose(left @ whitener, other @ whitener, rtol=1e-12)


def test_chi_square_is_that_of_the_covariance_of_the_pins_that_are_sure(learned):
    sure = np.arange(PINS) % 3 > 0
    rows = np.flatnonzero(np.tile(sure, 2))
    left = drawn(1, seed=5)[0]
    scaled = (left * np.sqrt(WEIGHT))[rows]
    part = learned.covariance[np.ix_(rows, rows)]
    expected = scaled @ np.linalg.solve(part, scaled)
    assert ((left @ learned.whitener(sure)) ** 2).sum() == pytest.approx(expected, rel=1e-9)


def test_nothing_is_known_better_than_the_noise_lets_it():
    quiet = ModelError.learn(1e-9 * drawn(FEWEST), WEIGHT)
    np.testing.assert_allclose(quiet.covariance, np.eye(2 * PINS), atol=1e-9)


def test_too_few_presses_teach_nothing():
    assert not ModelError.learn(drawn(FEWEST - 1), WEIGHT).learned
    assert ModelError.learn(drawn(FEWEST), WEIGHT).learned
    assert not ModelError.unknown(WEIGHT).learned
