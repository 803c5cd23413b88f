"""Statistics as functions of cluster weights, for `bca_interval`.

Each builder takes one row per value and the value's cluster number 0..G-1, and returns a function
of (B, G) weights. Where sums suffice, the values are summed per cluster once, beforehand.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactibench.stats.bca import Statistic
from tactibench.stats.clusters import FloatArray, IntArray, cluster_sums, finite


def ratio(
    numerator: npt.ArrayLike, denominator: npt.ArrayLike, codes: IntArray, clusters: int
) -> Statistic:
    """sum(numerator) / sum(denominator); a mean where the denominator is 1."""
    columns = np.column_stack([finite(numerator, "numerator"), finite(denominator, "denominator")])
    sums = cluster_sums(columns, codes, clusters)

    def statistic(weights: FloatArray) -> FloatArray:
        total = weights @ sums
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(total[:, 0] / total[:, 1])

    return statistic


def f1(
    matched: npt.ArrayLike,
    true: npt.ArrayLike,
    predicted: npt.ArrayLike,
    codes: IntArray,
    clusters: int,
) -> Statistic:
    """F1 = 2 matched / (true + predicted), of counts per frame."""
    both = np.asarray(true, dtype=np.float64) + np.asarray(predicted, dtype=np.float64)
    return ratio(2 * np.asarray(matched, dtype=np.float64), both, codes, clusters)


def r_squared(
    target: npt.ArrayLike, predicted: npt.ArrayLike, codes: IntArray, clusters: int
) -> Statistic:
    """1 - sum (y - f)^2 / sum (y - mean y)^2, averaged over the columns of (n, K) values."""
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


def quantile(values: npt.ArrayLike, q: float, codes: IntArray) -> Statistic:
    """Smallest value whose cumulative weight reaches the share q (the inverted distribution)."""
    array = finite(values, "values")
    order = np.argsort(array, kind="stable")
    array, codes = array[order], codes[order]

    def statistic(weights: FloatArray) -> FloatArray:
        cumulative = np.cumsum(weights[:, codes], axis=1)
        wanted = q * cumulative[:, -1:]
        reached = cumulative >= wanted - 1e-9 * cumulative[:, -1:]
        return np.asarray(array[reached.argmax(axis=1)])

    return statistic
