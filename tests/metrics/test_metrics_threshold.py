"""The 75 % point of a logistic curve."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit

from tactibench.metrics.score import score
from tactibench.metrics.threshold import fit_threshold

DISTANCES = np.arange(6.5, 12.01, 0.5)


def answers(probability, n, rng):
    distance = np.repeat(DISTANCES, n)
    return distance, (rng.random(len(distance)) < np.repeat(probability, n)) * 1.0


def exactly(probability, n):
    """As many hits as the probability asks for, so that the fit must return the curve."""
    hits = [np.arange(n) < round(p * n) for p in probability]
    return np.repeat(DISTANCES, n), np.concatenate(hits) * 1.0


def test_two_distances_determine_the_line():
    # logits log(3) +- 1 at 8 and 10 mm: the 75 % point lies half way
    shares = expit(np.log(3) + np.array([-1.0, 1.0]))
    n = 100_000
    distance = np.repeat([8.0, 10.0], n)
    hits = np.concatenate([np.arange(n) < round(s * n) for s in shares]) * 1.0
    found = fit_threshold(distance, hits, np.arange(2 * n))
    assert found.value == pytest.approx(9.0, abs=1e-3)
    assert found.censored is None


@pytest.mark.parametrize(("middle", "slope"), [(8.2, 1.5), (9.7, 0.8), (10.4, 4.0)])
def test_a_known_curve_is_recovered(middle, slope):
    curve = expit(slope * (DISTANCES - middle))
    found = fit_threshold(*exactly(curve, 20_000), np.arange(20_000 * 12))
    assert found.value == pytest.approx(middle + np.log(3) / slope, abs=2e-3)
    assert found.low < found.value < found.high


def test_against_a_general_optimiser_and_likelihood_ratio():
    rng = np.random.default_rng(4)
    distance, hits = answers(expit(1.2 * (DISTANCES - 8.5)), 40, rng)

    def cost(ab):
        p = expit(ab[0] + ab[1] * (distance - 9))
        return -np.log(np.where(hits == 1, p, 1 - p)).sum()

    best = minimize(cost, [0.0, 1.0], method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-10})
    found = fit_threshold(distance, hits, np.arange(len(hits)))
    assert found.value == pytest.approx(9 + (np.log(3) - best.x[0]) / best.x[1], abs=1e-4)
    for limit in (found.low, found.high):
        profile = min(cost([np.log(3) - b * (limit - 9), b]) for b in np.linspace(0.2, 3, 2801))
        assert 2 * (profile - best.fun) == pytest.approx(1.965**2, abs=0.02)


def test_a_perfect_step_lies_between_its_distances():
    found = fit_threshold(*exactly(DISTANCES > 9.1, 50), np.arange(600))
    assert 9.0 < found.value < 9.5
    assert 8.5 < found.low <= 9.1
    assert 9.4 <= found.high < 10


@pytest.mark.parametrize(
    ("share", "value", "censored"),
    [(1.0, 6.5, "<"), (0.9, 6.5, "<"), (0.5, 12.0, ">"), (0, 12, ">")],
)
def test_a_flat_curve_is_censored(share, value, censored):
    found = fit_threshold(*exactly(np.full(12, share), 100), np.arange(1200))
    assert (found.value, found.censored) == (value, censored)
    assert (found.low if censored == "<" else found.high) is None


def test_a_falling_curve_is_censored_by_its_level():
    found = fit_threshold(*exactly(np.linspace(0.6, 0.2, 12), 100), np.arange(1200))
    assert (found.value, found.censored) == (12.0, ">")
    found = fit_threshold(*exactly(np.linspace(0.99, 0.85, 12), 100), np.arange(1200))
    assert (found.value, found.censored) == (6.5, "<")


def test_frames_of_one_press_widen_the_interval():
    distance, hits = exactly(expit(1.5 * (DISTANCES - 9)), 60)
    alone = fit_threshold(distance, hits, np.arange(len(hits)))
    copied = fit_threshold(np.repeat(distance, 8), np.repeat(hits, 8), np.repeat(np.arange(720), 8))
    assert copied.value == pytest.approx(alone.value, abs=1e-4)
    assert copied.high - copied.low == pytest.approx(alone.high - alone.low, rel=0.01)


@pytest.mark.parametrize("fits", [30, pytest.param(240, marks=pytest.mark.long)])
def test_the_interval_covers(fits):
    rng = np.random.default_rng(9)
    covered = 0
    for _ in range(fits):
        found = fit_threshold(*answers(expit(2 * (DISTANCES - 9)), 12, rng), np.arange(144))
        covered += found.low <= 9 + np.log(3) / 2 <= found.high
    assert covered / fits > 0.88


def test_one_distance_or_none_has_no_threshold(two_point, kinds):
    assert fit_threshold(np.full(9, 8.0), np.ones(9), np.arange(9)).value is None
    assert fit_threshold(np.empty(0), np.empty(0), np.empty(0)).value is None
    (row,) = score(["threshold_mm"], two_point, rng=np.random.default_rng(0))
    assert row.n == 180
