"""Clustered intervals against other ways to compute them, and their coverage."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tactibench.stats import (
    Estimate,
    effective_size,
    mean_interval,
    rate_interval,
    ratio_interval,
    rms_interval,
    share_interval,
)


def regression_on_a_constant(y, clusters, level=0.95):
    """Sandwich (X'X)^-1 X' Omega X (X'X)^-1 with the CR1 factor, as regression packages have it."""
    X = np.ones((len(y), 1))
    bread = np.linalg.inv(X.T @ X)
    residual = y - X @ (bread @ X.T @ y)
    labels = sorted(set(clusters.tolist()))
    meat = np.zeros((1, 1))
    for g in labels:
        s = X[clusters == g].T @ residual[clusters == g]
        meat += np.outer(s, s)
    G, n, k = len(labels), len(y), 1
    V = bread @ meat @ bread * G / (G - 1) * (n - 1) / (n - k)
    half = stats.t.ppf((1 + level) / 2, G - 1) * np.sqrt(V[0, 0])
    return y.mean() - half, y.mean() + half


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 12), st.integers(0, 10**6), st.sampled_from([0.5, 0.9, 0.95, 0.99]))
def test_mean_against_a_cluster_robust_regression(count, seed, level):
    rng = np.random.default_rng(seed)
    clusters = np.concatenate([np.arange(count), rng.integers(0, count, 30)])
    y = rng.normal(2, 1, len(clusters)) + rng.normal(0, 1, count)[clusters]
    found = mean_interval(y, clusters, level=level)
    assert (found.low, found.high) == pytest.approx(regression_on_a_constant(y, clusters, level))
    assert (found.n, found.clusters) == (len(y), count)


def test_frames_repeated_in_their_press_change_nothing():
    y, press = np.random.default_rng(1).normal(size=20), np.arange(20)
    once, often = mean_interval(y, press), mean_interval(np.repeat(y, 7), np.repeat(press, 7))
    assert (often.low, often.value, often.high) == pytest.approx((once.low, once.value, once.high))
    assert (often.n, often.clusters) == (140, 20)


def test_labels_may_be_text_and_in_any_order():
    y, press = np.random.default_rng(2).normal(size=30), np.arange(30) % 6
    names = np.array([f"press {p}" for p in press])
    order = np.random.default_rng(3).permutation(30)
    a, b = mean_interval(y, press), mean_interval(y[order], names[order])
    assert (a.low, a.high) == pytest.approx((b.low, b.high))


@pytest.mark.parametrize("interval", [mean_interval, rms_interval, share_interval, rate_interval])
def test_one_press_has_no_interval_and_none_has_no_value(interval):
    found = interval(np.array([1.0, 1.0, 0.0]), np.zeros(3))
    assert found.value is not None
    assert (found.low, found.high, found.clusters) == (None, None, 1)
    assert interval(np.empty(0), np.empty(0)) == Estimate.nothing()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_is_refused_and_counted(bad):
    with pytest.raises(ValueError, match="1 of 3 values are not finite"):
        mean_interval([1.0, bad, 2.0], np.arange(3))
    with pytest.raises(ValueError, match="not finite"):
        share_interval([1.0, bad, 0.0], np.arange(3))
    with pytest.raises(ValueError, match="low of an estimate"):
        Estimate(1.0, bad, 2.0, 3, 3)


def test_rms_goes_through_the_mean_square():
    e, press = np.random.default_rng(4).normal(size=60), np.arange(60) // 3
    square, found = mean_interval(e**2, press), rms_interval(e**2, press)
    assert found.value == pytest.approx(np.sqrt(np.mean(e**2)))
    assert (found.low**2, found.high**2) == pytest.approx((square.low, square.high))


def test_a_ratio_is_a_weighted_mean_and_scales():
    rng = np.random.default_rng(5)
    a, b, press = rng.random(40), rng.uniform(1, 2, 40), np.arange(40) // 2
    found = ratio_interval(a, b, press)
    assert found.value == pytest.approx(a.sum() / b.sum())
    doubled = ratio_interval(2 * a, b, press)
    assert (doubled.low, doubled.high) == pytest.approx((2 * found.low, 2 * found.high))
    # delta method against the jackknife over presses
    left_out = [a[press != g].sum() / b[press != g].sum() for g in range(20)]
    sd = np.sqrt(19 / 20 * ((left_out - np.mean(left_out)) ** 2).sum())
    assert found.high - found.value == pytest.approx(stats.t.ppf(0.975, 19) * sd, rel=0.05)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_share_of_none_or_all_is_not_certain(value):
    found = share_interval(np.full(40, value), np.arange(40) // 4)
    assert found.value == value
    assert 0 <= found.low <= found.high <= 1
    assert found.high - found.low > 0.2  # ten presses, not forty frames


def test_presses_that_agree_in_themselves_count_once():
    press = np.repeat(np.arange(50), 8)
    hits = np.repeat(np.arange(50) < 20, 8) * 1.0
    assert effective_size(hits, press) == pytest.approx(49)
    assert effective_size(np.tile([0.0, 1.0], 200), press) == 400


def test_a_share_of_something_else_is_refused():
    with pytest.raises(ValueError, match="not all 0 or 1"):
        share_interval([0.5, 1.0], np.arange(2))


def test_clustered_t_covers_where_the_naive_interval_does_not():
    correlation, count = 0.3, 10
    rng, frames, runs = np.random.default_rng(7), 20, 800
    press = np.repeat(np.arange(count), frames)
    covered = naive = 0
    for _ in range(runs):
        shared = rng.normal(0, np.sqrt(correlation), count)[press]
        y = shared + rng.normal(0, np.sqrt(1 - correlation), count * frames)
        found = mean_interval(y, press)
        covered += found.low <= 0 <= found.high
        naive += abs(y.mean()) <= 1.96 * y.std() / np.sqrt(len(y))
    assert covered / runs == pytest.approx(0.95, abs=0.03)
    assert naive / runs < 0.7


@pytest.mark.parametrize(("hits", "n"), [(1, 12), (12, 40), (39, 40), (500, 1000)])
def test_the_ends_of_a_share_solve_wilsons_equation_with_the_t_quantile(hits, n):
    values = np.arange(n) < hits
    estimate = share_interval(values, np.arange(n))
    size = effective_size(values, np.arange(n))
    t = stats.t.ppf(0.975, n - 1)
    for end in (estimate.low, estimate.high):
        assert size * (hits / n - end) ** 2 == pytest.approx(t**2 * end * (1 - end))
