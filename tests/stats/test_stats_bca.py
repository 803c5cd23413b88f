"""BCa against scipy for unclustered data, and where it must decline."""

import numpy as np
import pytest
from scipy import stats
from sklearn.metrics import r2_score

from tactibench.stats import (
    acceleration,
    bca_interval,
    bootstrap_values,
    cluster_sums,
    jackknife_values,
    r_squared,
)


def mean_of(y, codes=None):
    """The mean of all values as a statistic of the weights of their clusters."""
    codes = np.arange(len(y)) if codes is None else codes
    sums, counts = np.bincount(codes, y), np.bincount(codes)
    return lambda weights: (weights @ sums) / (weights @ counts)


@pytest.mark.parametrize("level", [0.8, 0.95])
@pytest.mark.parametrize("seed", [0, 1])
def test_mean_of_skewed_values_against_scipy(seed, level):
    # both draw (resamples, n) indices from the generator, so equal seeds give equal resamples
    y = np.random.default_rng(seed).exponential(size=40)
    found = bca_interval(mean_of(y), 40, rng=np.random.default_rng(1), level=level)
    other = stats.bootstrap(
        (y,), np.mean, method="BCa", n_resamples=2000, confidence_level=level, rng=1
    )
    assert found == pytest.approx(tuple(other.confidence_interval), rel=1e-9)


def test_blocks_do_not_change_the_jackknife(monkeypatch):
    y = np.random.default_rng(7).normal(size=50)
    whole = jackknife_values(mean_of(y), 50)
    monkeypatch.setattr("tactibench.stats.bootstrap.BLOCK", 160)
    assert jackknife_values(mean_of(y), 50) == pytest.approx(whole)
    assert whole == pytest.approx([np.delete(y, i).mean() for i in range(50)])
    assert len(bootstrap_values(mean_of(y), 50, 101, np.random.default_rng(0))) == 101


def test_acceleration_of_a_mean_is_a_sixth_of_its_standardised_skewness():
    y = np.random.default_rng(8).exponential(size=500)
    expected = stats.skew(y) / (6 * np.sqrt(500))
    assert acceleration(jackknife_values(mean_of(y), 500)) == pytest.approx(expected)
    assert acceleration(np.ones(5)) == 0


def test_it_declines_what_it_cannot_support():
    rng = np.random.default_rng(9)
    assert bca_interval(mean_of(np.array([1.0])), 1, rng=rng) is None
    assert bca_interval(mean_of(np.full(9, 2.0)), 9, rng=rng) is None
    # two presses of equal target: half of the resamples have no variance to explain
    two = r_squared([0.0, 1.0], [0.1, 0.8], np.arange(2), 2)
    assert bca_interval(two, 2, rng=rng) is None
    with pytest.raises(ValueError, match="statistic of a BCa interval is nan"):
        bca_interval(lambda w: np.full(len(w), np.nan), 5, rng=rng)


def test_an_extreme_statistic_keeps_finite_limits():
    y = np.random.default_rng(10).exponential(size=15)
    rng = np.random.default_rng(0)
    low, high = bca_interval(lambda w: np.where(w > 0, y, 0).max(axis=1), 15, rng=rng)
    assert y.min() <= low <= high <= y.max()


def test_rounding_of_equal_values_moves_no_limit():
    mean = mean_of(np.repeat([0.0, 1.0, 2.0], [5, 6, 4]))

    def rounded(weights):
        return mean(weights) * (1 + 4e-16 * (weights[:, 0] % 2))

    exact, found = (bca_interval(f, 15, rng=np.random.default_rng(3)) for f in (mean, rounded))
    assert found == pytest.approx(exact, rel=1e-12)


def test_weighted_r2_is_that_of_repeated_rows():
    rng = np.random.default_rng(12)
    y = rng.normal(50, 1, (40, 2))
    f, codes = y + rng.normal(0, 0.3, (40, 2)), np.repeat(np.arange(10), 4)
    weights = rng.integers(0, 4, (6, 10)).astype(float)
    repeated = []
    for w in weights:
        times = w[codes].astype(int)
        repeated.append(r2_score(np.repeat(y, times, 0), np.repeat(f, times, 0)))
    assert r_squared(y, f, codes, 10)(weights) == pytest.approx(repeated)


def test_cluster_sums_of_columns():
    values, codes = np.arange(12.0).reshape(6, 2), np.array([0, 1, 1, 3, 3, 3])
    expected = [[0, 1], [6, 8], [0, 0], [24, 27]]
    assert (cluster_sums(values, codes, 4) == expected).all()
