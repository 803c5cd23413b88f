"""BCa bootstrap over clusters for any statistic (Efron 1987).

A statistic is a function of weights: from (B, G) numbers of times that each of G clusters was drawn
it computes (B,) values. So all resamples are computed in a few matrix products, and the jackknife
is the same function, called with one weight of zero.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr, ndtri  # scipy.stats takes a second to import

from tactibench.stats.intervals import FloatArray, IntArray, cluster_sums, finite

Statistic = Callable[[FloatArray], FloatArray]

BLOCK = 2**22
"""Weights handed to a statistic at once, to bound the memory (32 MiB of float64)."""

LOST = 0.05
"""Share of resamples on which a statistic may be undefined; with more there is no interval."""


def r_squared(
    target: npt.ArrayLike, predicted: npt.ArrayLike, codes: IntArray, clusters: int
) -> Statistic:
    """Return the statistic R^2 = 1 - sum (y - f)^2 / sum (y - mean y)^2, averaged over columns.

    Sums suffice: the values are summed per cluster once, beforehand.

    Args:
        target: (n,) or (n, K) true values y.
        predicted: Predicted values f, of the same shape.
        codes: (n,) number of each value's cluster, 0..clusters - 1.
        clusters: Number of clusters.

    Raises:
        ValueError: A value is not finite.
    """
    y, f = np.atleast_2d(finite(target, "target").T).T, np.atleast_2d(finite(predicted, "f").T).T
    y, residual = y - y.mean(axis=0), y - f  # centred: keeps the sums of squares accurate
    k = y.shape[1]
    sums = cluster_sums(np.hstack([residual**2, y**2, y, np.ones((len(y), 1))]), codes, clusters)

    def statistic(weights: FloatArray) -> FloatArray:
        total = weights @ sums
        wrong, square, plain, n = np.split(total, [k, 2 * k, 3 * k], axis=1)
        spread = square - plain**2 / np.maximum(n, 1e-300)
        # what rounding leaves of a constant target is no spread
        spread[spread <= 1e-12 * square] = 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((1 - wrong / spread).mean(axis=1))

    return statistic


def cluster_weights(clusters: int, resamples: int, rng: np.random.Generator) -> FloatArray:
    """Return how often each cluster is drawn with replacement, (resamples, clusters).

    Args:
        clusters: Number of clusters.
        resamples: Number of resamples.
        rng: Random numbers of the draws.
    """
    drawn = rng.integers(clusters, size=(resamples, clusters))
    drawn += clusters * np.arange(resamples)[:, None]
    counts = np.bincount(drawn.ravel(), minlength=resamples * clusters)
    return counts.reshape(resamples, clusters).astype(np.float64)


def bootstrap_values(
    statistic: Statistic, clusters: int, resamples: int, rng: np.random.Generator
) -> FloatArray:
    """Return the (resamples,) values of the statistic over resampled clusters.

    Args:
        statistic: Function from (B, G) weights of clusters to (B,) values.
        clusters: Number of clusters G.
        resamples: Number of resamples.
        rng: Random numbers of the bootstrap.
    """
    rows = max(1, BLOCK // clusters)
    sizes = [min(rows, resamples - start) for start in range(0, resamples, rows)]
    return np.concatenate([statistic(cluster_weights(clusters, s, rng)) for s in sizes])


def jackknife_values(statistic: Statistic, clusters: int) -> FloatArray:
    """Return the (clusters,) values of the statistic with one cluster left out."""
    rows = max(1, BLOCK // clusters)
    values = []
    for start in range(0, clusters, rows):
        left_out = np.arange(start, min(start + rows, clusters))
        weights = np.ones((len(left_out), clusters))
        weights[np.arange(len(left_out)), left_out] = 0.0
        values.append(statistic(weights))
    return np.concatenate(values)


def acceleration(jackknife: FloatArray) -> float:
    """Return a = sum(d^3) / (6 sum(d^2)^1.5), d the jackknife's deviations from its mean."""
    deviation = jackknife.mean() - jackknife
    scale = float((deviation**2).sum())
    return float((deviation**3).sum()) / (6 * scale**1.5) if scale > 0 else 0.0


def bca_interval(
    statistic: Statistic,
    clusters: int,
    *,
    rng: np.random.Generator,
    level: float = 0.95,
    resamples: int = 2000,
) -> tuple[float, float] | None:
    """Return (low, high), or None where the data cannot support an interval.

    That is the case with fewer than two clusters, with a statistic that is the same on every
    resample, and with one that is undefined (not finite) on more than 5 % of the resamples or on
    any jackknife sample. A few undefined resamples are left out. There is also no interval where it
    would not hold the value itself: R^2 of a constant answer is almost the largest of all its
    resamples.

    Args:
        statistic: Function from (B, G) weights of clusters to (B,) values.
        clusters: Number of clusters G.
        rng: Random numbers of the bootstrap.
        level: Level of the interval.
        resamples: Number of resamples.

    Raises:
        ValueError: The statistic of all clusters is not finite.
    """
    if clusters < 2:
        return None
    value = float(statistic(np.ones((1, clusters)))[0])
    if not np.isfinite(value):
        raise ValueError(f"the statistic of a BCa interval is {value}")
    drawn = bootstrap_values(statistic, clusters, resamples, rng)
    usable = drawn[np.isfinite(drawn)]
    jackknife = jackknife_values(statistic, clusters)
    if len(usable) < (1 - LOST) * resamples or not np.isfinite(jackknife).all():
        return None
    tie = 1e-12 * max(1.0, abs(value))  # what rounding makes of two equal values
    if np.ptp(usable) <= tie:
        return None
    below = ((usable < value - tie).sum() + (usable <= value + tie).sum()) / (2 * len(usable))
    # a value outside all resamples would give an infinite bias correction
    below = float(np.clip(below, 1 / (len(usable) + 1), len(usable) / (len(usable) + 1)))
    bias, a = ndtri(below), acceleration(jackknife)
    shifted = bias + ndtri([(1 - level) / 2, (1 + level) / 2])
    # beyond the pole of the correction the adjusted quantile is the extreme one
    tail = np.where(1 - a * shifted > 0, shifted / np.maximum(1 - a * shifted, 1e-12), 38 * shifted)
    low, high = np.quantile(usable, ndtr(bias + tail))
    return (float(low), float(high)) if low <= value <= high else None
