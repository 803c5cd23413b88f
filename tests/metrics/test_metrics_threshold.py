"""The 75 % point of a psychometric curve, and how well the curve fits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.special import expit, logit, xlogy
from sklearn.isotonic import IsotonicRegression

from tactibench.metrics import (
    MISFIT,
    checked_threshold,
    fit_threshold,
    interpolated_threshold,
    isotonic_shares,
    threshold,
)
from tactibench.metrics.registry import score
from tactibench.metrics.threshold import crossing

DISTANCES = np.arange(6.5, 12.01, 0.5)


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch):
    """A fifth of the fits behind a p, which is then a multiple of 0.005."""
    monkeypatch.setattr(threshold, "RESAMPLES", 199)


def answers(probability, n, rng):
    distance = np.repeat(DISTANCES, n)
    return distance, (rng.random(len(distance)) < np.repeat(probability, n)) * 1.0


def exactly(probability, n):
    """As many hits as the probability asks for, so that the fit must return the curve."""
    hits = [np.arange(n) < round(p * n) for p in probability]
    return np.repeat(DISTANCES, n), np.concatenate(hits) * 1.0


@pytest.mark.parametrize(("middle", "slope"), [(8.2, 1.5), (10.4, 4.0)])
def test_a_known_curve_is_recovered(middle, slope):
    curve = expit(slope * (DISTANCES - middle))
    found = fit_threshold(*exactly(curve, 400), np.arange(400 * 12))
    # Whole hits of 400 are off by an eighth of a per cent at most.
    assert found.value == pytest.approx(middle + np.log(3) / slope, abs=4e-3)
    assert found.low < found.value < found.high


def test_a_falling_curve_is_censored_by_its_level():
    found = fit_threshold(*exactly(np.linspace(0.99, 0.85, 12), 100), np.arange(1200))
    assert (found.value, found.censored) == (6.5, "<")


@pytest.mark.long
def test_frames_of_one_press_widen_the_interval():
    distance, hits = exactly(expit(1.5 * (DISTANCES - 9)), 20)
    alone = fit_threshold(distance, hits, np.arange(len(hits)))
    copied = fit_threshold(np.repeat(distance, 8), np.repeat(hits, 8), np.repeat(np.arange(240), 8))
    assert copied.value == pytest.approx(alone.value, abs=1e-4)
    assert copied.high - copied.low == pytest.approx(alone.high - alone.low, rel=0.05)


def test_one_distance_or_none_has_no_threshold(two_point, kinds):
    assert fit_threshold(np.full(9, 8.0), np.ones(9), np.arange(9)).value is None
    assert fit_threshold(np.empty(0), np.empty(0), np.empty(0)).value is None
    (row,) = score(["threshold_mm"], two_point, rng=np.random.default_rng(0))
    assert row.n == 180


def lapsing(middle, slope, lapse):
    """P of every distance, and where it is 75 % of all pairs."""
    return (1 - lapse) * expit(slope * (DISTANCES - middle)), middle + logit(
        0.75 / (1 - lapse)
    ) / slope


def checked(distance, hits, press=None, seed=0, **options):
    press = np.arange(len(hits)) if press is None else press
    return checked_threshold(distance, hits, press, rng=np.random.default_rng(seed), **options)


@pytest.mark.long
@pytest.mark.parametrize("lapse", [0.0, 0.08])
def test_a_known_lapse_rate_is_recovered(lapse):
    curve, expected = lapsing(8.4, 1.7, lapse)
    fit = checked(*exactly(curve, 4_000))
    assert fit.estimate.value == pytest.approx(expected, abs=3e-3)
    assert fit.lapse == pytest.approx(lapse, abs=1e-3)
    assert fit.estimate.method is None
    assert fit.goodness.deviance < 0.1
    assert fit.goodness.p > 0.99


@pytest.mark.long
def test_against_a_general_optimiser_of_threshold_slope_and_lapse():
    curve, _ = lapsing(8.2, 1.1, 0.03)
    distance, hits = answers(curve, 100, np.random.default_rng(0))
    h = np.array([hits[distance == d].sum() for d in DISTANCES])

    def deviance(at):
        m, b, g = at[0], np.exp(at[1]), 0.1 * expit(at[2])
        p = (1 - g) * expit(logit(0.75 / (1 - g)) + b * (DISTANCES - m))
        fit = xlogy(h, p) + xlogy(100 - h, 1 - p)
        return 2 * (xlogy(h, h / 100) + xlogy(100 - h, 1 - h / 100) - fit).sum()

    options = {"xatol": 1e-9, "fatol": 1e-11, "maxiter": 5000, "maxfev": 5000}
    starts = [(m, b, g) for m, b in ((8, 0.5), (10, -0.5)) for g in (-3, 3)]
    best = min(
        (minimize(deviance, start, method="Nelder-Mead", options=options) for start in starts),
        key=lambda one: one.fun,
    )
    fit = checked(distance, hits)
    curve = fit_threshold(distance, hits, np.arange(1200))
    assert curve.value == pytest.approx(best.x[0], abs=2e-5)
    for limit in (curve.low, curve.high):  # by half the square of Student's t
        rest = minimize(
            lambda at, m=limit: deviance([m, *at]),
            best.x[1:],
            method="Nelder-Mead",
            options=options,
        )
        assert rest.fun - best.fun == pytest.approx(1.962**2, abs=0.01)
    assert fit.lapse == pytest.approx(0.1 * expit(best.x[2]), abs=1e-4)
    assert fit.goodness.deviance == pytest.approx(best.fun, abs=1e-5)
    assert fit.goodness.freedom == 9


def test_without_a_resolved_pair_no_lapse_rate_is_likelier():
    assert checked(*exactly(np.zeros(12), 5)).lapse is None


def test_a_perfect_step_fits_perfectly():
    fit = checked(*exactly(DISTANCES > 9.1, 50))
    assert 9.0 < fit.estimate.value < 9.5
    assert 8.5 < fit.estimate.low <= 9.1
    assert 9.4 <= fit.estimate.high < 10
    assert fit.lapse == pytest.approx(0, abs=1e-4)
    assert fit.goodness.deviance < 0.01  # a slope of 50 / mm is not infinite
    assert fit.goodness.p == 1.0


@pytest.mark.parametrize(("share", "value", "censored"), [(0.95, 6.5, "<"), (0, 12, ">")])
def test_all_resolved_and_none_are_censored_and_fit(share, value, censored):
    fit = checked(*exactly(np.full(12, share), 100))
    assert (fit.estimate.value, fit.estimate.censored) == (value, censored)
    assert fit.estimate.method is None
    assert fit.goodness.deviance == pytest.approx(0, abs=1e-3)
    assert fit.goodness.p > 0.9


@pytest.mark.long  # thousands of bootstrap fits
@pytest.mark.parametrize("shares", [(0.9, 0.9, 0.3) * 4, tuple(np.linspace(0.6, 0.2, 12))])
def test_no_curve_gives_the_crossing_and_says_so(shares):
    distance, hits = exactly(np.array(shares), 100)
    fit = checked(distance, hits)
    assert fit.goodness.p < MISFIT
    assert fit.estimate.method == "interpolated"
    again = checked(distance, hits, seed=1)
    assert again.goodness == fit.goodness  # its random numbers are its own
    assert fit.estimate == checked(distance, hits).estimate


def test_two_distances_leave_nothing_to_check():
    distance, hits = (
        np.repeat([8.0, 10.0], 50),
        np.concatenate([np.arange(50) < k for k in (20, 45)]),
    )
    fit = checked(distance, hits * 1.0)
    assert (fit.goodness.freedom, fit.goodness.p) == (0, None)
    assert fit.estimate.method is None
    nothing = checked(np.full(9, 8.0), np.ones(9))
    assert (nothing.estimate.value, nothing.lapse, nothing.goodness) == (None, None, None)


@pytest.mark.long  # thousands of bootstrap fits
def test_frames_of_one_press_do_not_make_a_misfit():
    rng = np.random.default_rng(3)
    curve, _ = lapsing(9.0, 1.5, 0.03)
    distance, hits = answers(curve, 60, rng)
    copied = np.repeat(distance, 4), np.repeat(hits, 4), np.repeat(np.arange(720), 4)
    alone, together = checked(distance, hits), checked(*copied)
    assert together.goodness.deviance == pytest.approx(alone.goodness.deviance, rel=1e-3)
    assert together.goodness.p > 0.01


@pytest.mark.slow  # hundreds of fits
def test_p_is_uniform_where_the_curve_is_true():
    rng = np.random.default_rng(5)
    curve, _ = lapsing(9.0, 3.0, 0.0)  # steep: most distances add nothing to the deviance
    p = [checked(*answers(curve, 50, rng)).goodness.p for _ in range(20)]
    assert 0.2 < np.mean(np.array(p) < 0.5) < 0.8
    assert np.mean(np.array(p) < 0.05) < 0.3


@given(
    st.lists(st.tuples(st.integers(0, 9), st.integers(1, 9)), min_size=2, max_size=8).map(
        lambda pairs: [(min(h, n), n) for h, n in pairs]
    )
)
@settings(max_examples=100, deadline=None)
def test_isotonic_shares_are_those_of_scikit_learn(counts):
    hits, trials = np.array(counts, dtype=float).T
    expected = IsotonicRegression().fit_transform(
        np.arange(len(hits)), hits / trials, sample_weight=trials
    )
    np.testing.assert_allclose(isotonic_shares(hits[None], trials[None])[0], expected, atol=1e-9)


def test_the_crossing_lies_on_the_line_between_two_shares():
    distance = np.array([6.0, 7.0, 8.0])
    shares = np.array([[0.5, 0.7, 0.9], [0.8, 0.9, 1.0], [0.1, 0.2, 0.3], [0.0, 0.75, 1.0]])
    np.testing.assert_allclose(crossing(distance, shares), [7.25, 6.0, 8.0, 7.0])


def test_a_distance_that_a_resample_has_lost_is_stepped_over():
    hits, trials = np.array([[2.0, 0.0, 9.0], [0, 0, 8]]), np.array([[10.0, 0.0, 10.0], [0, 0, 10]])
    shares = isotonic_shares(hits, trials)
    assert shares[0, 0] == pytest.approx(0.2)
    assert shares[0, 1] in (shares[0, 0], shares[0, 2])
    found = crossing(np.array([6.0, 7.0, 8.0]), shares)
    assert np.isfinite(found).all()
    assert (found <= 8).all()


@pytest.mark.parametrize(("share", "value", "censored"), [(0.9, 6.5, "<"), (0.5, 12.0, ">")])
def test_a_crossing_outside_is_censored(share, value, censored):
    distance, hits = exactly(np.full(12, share), 100)
    found = interpolated_threshold(distance, hits, np.arange(1200), rng=np.random.default_rng(0))
    assert (found.value, found.censored, found.method) == (value, censored, "interpolated")
    assert (found.low if censored == "<" else found.high) is None


@pytest.mark.slow  # three minutes
def test_the_interval_with_lapses_covers():
    rng = np.random.default_rng(9)
    curve, expected = lapsing(9.0, 1.5, 0.03)
    covered = 0
    for _ in range(120):
        found = fit_threshold(*answers(curve, 50, rng), np.arange(600))
        covered += found.low <= expected <= found.high
    assert covered / 120 > 0.88


def test_what_a_protocol_asks_for(two_point):
    asked = [
        "threshold_mm",
        "threshold_lapse",
        "threshold_deviance",
        "threshold_freedom",
        "threshold_p",
    ]
    rows = {row.metric: row for row in score(asked, two_point, rng=np.random.default_rng(0))}
    backwards = score(asked[::-1], replace(two_point), rng=np.random.default_rng(0))
    assert {row.metric: row for row in backwards} == rows
    assert list(rows) == asked
    assert rows["threshold_freedom"].value == 0.0
    assert rows["threshold_p"].value is None
    assert rows["threshold_mm"].method is None
    assert "method" not in rows["threshold_mm"].json_values()
    assert rows["threshold_mm"].unit == "mm"
