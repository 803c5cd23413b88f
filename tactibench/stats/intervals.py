"""Clustered intervals for means, ratios, root mean squares, shares, rates and medians.

All but that of the median are built on the cluster-robust variance of a ratio r = sum(a) / sum(b):

    var(r) = G / (G - 1) * sum_g (sum_{i in g} (a_i - r b_i))^2 / (sum b)^2

with the t quantile of G - 1 degrees of freedom, G the number of clusters (Liang and Zeger 1986;
for b = 1 it is the variance of a least-squares intercept with CR1 errors). One cluster tells
nothing about the spread between clusters: its interval is None.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit  # scipy.stats takes a second to import


@dataclass(frozen=True)
class Estimate:
    """A value with its interval.

    Attributes:
        value: None where there is nothing to estimate from; never NaN.
        low: Lower limit of the interval; None where there is none.
        high: Upper limit of the interval; None where there is none.
        n: Number of values that were averaged.
        clusters: Number of presses that they come from.
        censored: "<" or ">" when the true value is only known to lie beyond ``value``.
        method: "interpolated" when no curve fits and the value was read between the measured
            shares.

    Raises:
        ValueError: The value or a limit is NaN or infinite.
    """

    value: float | None
    low: float | None
    high: float | None
    n: int
    clusters: int
    censored: str | None = None
    method: str | None = None

    def __post_init__(self) -> None:
        for name in ("value", "low", "high"):
            number = getattr(self, name)
            if number is not None and not math.isfinite(number):
                raise ValueError(f"the {name} of an estimate is {number}")

    @classmethod
    def nothing(cls) -> Estimate:
        """Return an estimate without a value, which is shown as n/a."""
        return cls(None, None, None, 0, 0)


def t_quantile(level: float, clusters: int) -> float:
    """Return the two-sided t quantile with clusters - 1 degrees of freedom."""
    return float(stdtrit(clusters - 1, (1 + level) / 2))


def clustered_variance(
    numerator: npt.ArrayLike, denominator: npt.ArrayLike, clusters: Labels
) -> tuple[float, float, int]:
    """Return the ratio of two sums, its cluster-robust variance and the number of clusters.

    With fewer than two clusters the variance is NaN.

    Args:
        numerator: (n,) terms of the first sum.
        denominator: (n,) terms of the second sum.
        clusters: (n,) press ids.
    """
    a, b = finite(numerator, "numerator"), finite(denominator, "denominator")
    codes, count = cluster_codes(clusters, len(a))
    ratio = float(a.sum() / b.sum())
    residual = cluster_sums(a - ratio * b, codes, count)
    spread = float((residual**2).sum()) / float(b.sum()) ** 2
    return ratio, spread * count / (count - 1) if count > 1 else math.nan, count


def ratio_interval(
    numerator: npt.ArrayLike,
    denominator: npt.ArrayLike,
    clusters: Labels,
    *,
    level: float = 0.95,
    floor: float = -math.inf,
) -> Estimate:
    """Return sum(numerator) / sum(denominator) with a clustered t interval.

    Args:
        numerator: (n,) terms of the first sum.
        denominator: (n,) terms of the second sum.
        clusters: (n,) press ids.
        level: Level of the interval.
        floor: Value at which the interval is cut off below.
    """
    n = np.size(numerator)
    if n == 0:
        return Estimate.nothing()
    ratio, variance, count = clustered_variance(numerator, denominator, clusters)
    if count < 2:
        return Estimate(ratio, None, None, n, count)
    half = t_quantile(level, count) * math.sqrt(variance)
    return Estimate(ratio, max(ratio - half, floor), ratio + half, n, count)


def mean_interval(
    values: npt.ArrayLike, clusters: Labels, *, level: float = 0.95, floor: float = -math.inf
) -> Estimate:
    """Return the mean with a clustered t interval.

    Args:
        values: (n,).
        clusters: (n,) press ids.
        level: Level of the interval.
        floor: Value at which the interval is cut off below.
    """
    return ratio_interval(values, np.ones(np.shape(values)), clusters, level=level, floor=floor)


def positive_mean_interval(
    values: npt.ArrayLike, clusters: Labels, *, level: float = 0.95
) -> Estimate:
    """Return the mean of values that cannot be negative; its interval does not reach below 0.

    Args:
        values: (n,), such as absolute errors.
        clusters: (n,) press ids.
        level: Level of the interval.
    """
    return mean_interval(values, clusters, level=level, floor=0.0)


def root(square: Estimate) -> Estimate:
    """Return the square root of an estimate and of its limits."""

    def take(x: float | None) -> float | None:
        return None if x is None else math.sqrt(max(x, 0.0))

    return Estimate(
        take(square.value), take(square.low), take(square.high), square.n, square.clusters
    )


def rms_interval(squares: npt.ArrayLike, clusters: Labels, *, level: float = 0.95) -> Estimate:
    """Return sqrt(mean(squares)), with the root of the mean square's interval.

    Args:
        squares: (n,) squared errors.
        clusters: (n,) press ids.
        level: Level of the interval.
    """
    return root(positive_mean_interval(squares, clusters, level=level))


def effective_size(hits: npt.ArrayLike, clusters: Labels) -> float:
    """Return the number of independent yes/no values that would have the clustered variance.

    It is p (1 - p) / var, at most n. With p = 0 or 1 the data say nothing about the correlation
    inside a press, so a press counts once.

    Args:
        hits: (n,) 0 or 1.
        clusters: (n,) press ids.
    """
    share, variance, count = clustered_variance(hits, np.ones(np.shape(hits)), clusters)
    if not 0 < share < 1 or count < 2:
        return float(count)
    n = float(np.size(hits))
    return n if variance == 0 else min(n, share * (1 - share) / variance)


def share_interval(hits: npt.ArrayLike, clusters: Labels, *, level: float = 0.95) -> Estimate:
    """Return the share of ones, with a Wilson interval of the effective size and t quantile.

    The interval stays inside 0..1 and keeps a width at 0 and 1, where a t interval would claim
    certainty.

    Args:
        hits: (n,) 0 or 1.
        clusters: (n,) press ids.
        level: Level of the interval.

    Raises:
        ValueError: A value is neither 0 nor 1.
    """
    values = finite(hits, "hits")
    if not np.isin(values, (0.0, 1.0)).all():
        raise ValueError("a share is taken of values that are not all 0 or 1")
    if len(values) == 0:
        return Estimate.nothing()
    _, count = cluster_codes(clusters, len(values))
    share = float(values.mean())
    if count < 2:
        return Estimate(share, None, None, len(values), count)
    size, t = effective_size(values, clusters), t_quantile(level, count)
    centre = (share + t**2 / (2 * size)) / (1 + t**2 / size)
    half = t / (1 + t**2 / size) * math.sqrt(share * (1 - share) / size + t**2 / (4 * size**2))
    # rounding must not push the share itself out of its interval at 0 and 1
    low, high = min(max(centre - half, 0.0), share), max(min(centre + half, 1.0), share)
    return Estimate(share, low, high, len(values), count)


def rate_interval(counts: npt.ArrayLike, clusters: Labels, *, level: float = 0.95) -> Estimate:
    """Return the mean of event counts with a clustered t interval.

    With no event in G presses the upper limit is the exact one of a Poisson distribution,
    -log((1 - level) / 2) / G.

    Args:
        counts: (n,) numbers of events.
        clusters: (n,) press ids.
        level: Level of the interval.
    """
    estimate = positive_mean_interval(counts, clusters, level=level)
    if estimate.value == 0.0 and estimate.clusters > 1:
        high = -math.log((1 - level) / 2) / estimate.clusters
        return Estimate(0.0, 0.0, high, estimate.n, estimate.clusters)
    return estimate


FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
Labels = npt.NDArray[Any]


def finite(values: npt.ArrayLike, name: str) -> FloatArray:
    """Return the values as float64.

    Args:
        values: Any shape.
        name: Name of the values, for the error.

    Raises:
        ValueError: A value is not finite. The message counts such values.
    """
    array = np.asarray(values, dtype=np.float64)
    bad = int(array.size - np.isfinite(array).sum())
    if bad:
        raise ValueError(f"{name}: {bad} of {array.size} values are not finite")
    return array


def cluster_codes(labels: npt.ArrayLike, n: int) -> tuple[IntArray, int]:
    """Return (n,) codes 0..G - 1 of the labels of n values, and the number of clusters G.

    Raises:
        ValueError: There is not one label for each value.
    """
    array = np.asarray(labels)
    if array.shape != (n,):
        raise ValueError(f"{n} values have cluster labels of shape {array.shape}")
    unique, codes = np.unique(array, return_inverse=True)
    return codes.reshape(-1), len(unique)


def cluster_sums(values: FloatArray, codes: IntArray, count: int) -> FloatArray:
    """Return the sums over each cluster, (G,) or (G, K), of (n,) or (n, K) values.

    Args:
        values: (n,) or (n, K).
        codes: (n,) number of each value's cluster, 0..G - 1.
        count: Number of clusters G.
    """
    if values.ndim == 1:
        return np.bincount(codes, values, count).astype(np.float64)
    return np.stack([np.bincount(codes, column, count) for column in values.T], axis=1)


DOUBLE = 2.0
"""A model counts as broken down where its error is this many times that of the easy case."""


def mean_ratio(
    values: npt.ArrayLike,
    clusters: Labels,
    reference: npt.ArrayLike,
    reference_clusters: Labels,
    *,
    level: float = 0.95,
) -> Estimate:
    """Return r = mean(values) / mean(reference), both positive, with an interval on the log scale.

    Linearised, log r - log rho ~ sum over clusters g of
    u_g = sum_{i in g} (a_i - A) / (n_a A) - sum_{j in g} (b_j - B) / (n_b B),
    so that a press that occurs in both counts once, as the pair that it is;
    var = G / (G - 1) sum u_g^2, with the t quantile of G - 1 (Liang and Zeger 1986, delta method).
    There is no value where the mean of the reference is 0, and no interval where either mean is 0.

    Args:
        values: (n,).
        clusters: (n,) press ids.
        reference: (m,) values of the reference.
        reference_clusters: (m,) press ids.
        level: Level of the interval.

    Raises:
        ValueError: A value is not finite, or there is not one label for each value.
    """
    a, b = finite(values, "values"), finite(reference, "reference")
    if not len(a) or not len(b) or b.mean() == 0:
        return Estimate(None, None, None, len(a), 0)
    labels = np.concatenate([np.asarray(clusters), np.asarray(reference_clusters)])
    codes, count = cluster_codes(labels, len(a) + len(b))
    pressed = len(np.unique(np.asarray(clusters)))
    ratio = float(a.mean() / b.mean())
    if count < 2 or ratio == 0:
        return Estimate(ratio, None, None, len(a), pressed)
    parts = np.concatenate([a / a.mean() - 1, 1 - b / b.mean()])
    parts /= np.repeat([len(a), len(b)], [len(a), len(b)])
    sums = cluster_sums(parts, codes, count)
    half = t_quantile(level, count) * math.sqrt(count / (count - 1) * float((sums**2).sum()))
    if half > 700:  # exp would overflow: nothing is known
        return Estimate(ratio, None, None, len(a), pressed)
    return Estimate(ratio, ratio * math.exp(-half), ratio * math.exp(half), len(a), pressed)


def crossing(
    values: Sequence[float], ratios: Sequence[float | None], level: float = DOUBLE
) -> float | None:
    """Return the first value at which the polygon through (value, ratio) reaches a level.

    Args:
        values: From easy to hard, rising or falling.
        ratios: Ratio at each value; None where it is unknown.
        level: The level that is reached from below.

    Returns:
        The value; None where the level is not reached, or a ratio before it is unknown.
    """
    points = list(zip(values, ratios, strict=True))
    for (x0, y0), (x1, y1) in pairwise(points):
        if y0 is None or y1 is None:
            return None
        if y0 >= level:
            return x0
        if y1 >= level:
            return x0 + (x1 - x0) * (level - y0) / (y1 - y0)
    return None


def doubling(easy: float, values: Sequence[float], ratios: Sequence[Estimate]) -> Estimate:
    """Return the value at which the ratio to the easy case reaches 2.

    The ratio is 1 at the easy case and linear between the values. The limits of the interval are
    the values at which the upper and the lower ends of the ratios' intervals reach 2; a limit that
    is not reached is None. When the ratio stays below 2, the value is censored at the hardest one:
    ">" where values rise towards hard cases, "<" where they fall.

    Args:
        easy: Value of the easy case.
        values: Values of the other cases, from easy to hard.
        ratios: Ratio of the error at each of ``values`` to that of the easy case.
    """
    axis = (easy, *values)
    n = min((ratio.n for ratio in ratios), default=0)
    clusters = min((ratio.clusters for ratio in ratios), default=0)
    if not ratios or any(ratio.value is None for ratio in ratios):
        return Estimate(None, None, None, n, clusters)
    middle = crossing(axis, [1.0, *(ratio.value for ratio in ratios)])
    soon = crossing(axis, [1.0, *(ratio.high for ratio in ratios)])
    late = crossing(axis, [1.0, *(ratio.low for ratio in ratios)])
    rising = values[-1] > easy
    low, high = (soon, late) if rising else (late, soon)
    if middle is None:
        return Estimate(axis[-1], low, high, n, clusters, ">" if rising else "<")
    return Estimate(middle, low, high, n, clusters)


def median_by_ranks(values: FloatArray, *, level: float = 0.95) -> Estimate:
    """Return the median of (n,) independent values; inf stands for a value beyond all others.

    The k-th smallest and the k-th largest are the limits, k the largest number for which a
    binomial(n, 1/2) is below k with probability (1 - level) / 2 at most (Conover, Practical
    Nonparametric Statistics, 1999, section 3.2). Both limits are None where k is 0, and a median or
    limit that is inf is None.
    """
    from scipy.stats import binom  # takes a second to import

    n = len(values)
    if not n:
        return Estimate.nothing()
    ordered = np.sort(values)
    k = int(binom.ppf((1 - level) / 2, n, 0.5))
    ends = (float(ordered[k - 1]), float(ordered[n - k])) if k else (math.inf, math.inf)
    middle, low, high = (
        end if math.isfinite(end) else None for end in (float(np.median(ordered)), *ends)
    )
    return Estimate(middle, low, high, n, n)
