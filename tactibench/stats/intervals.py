"""Clustered intervals for means, ratios, root mean squares, shares and rates.

All are built on the cluster-robust variance of a ratio r = sum(a) / sum(b):

    var(r) = G / (G - 1) * sum_g (sum_{i in g} (a_i - r b_i))^2 / (sum b)^2

with the t quantile of G - 1 degrees of freedom, G the number of clusters (Liang and Zeger 1986;
for b = 1 it is the variance of a least-squares intercept with CR1 errors). One cluster tells
nothing about the spread between clusters: its interval is None.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit  # scipy.stats takes a second to import

from tactibench.stats.clusters import Labels, cluster_codes, cluster_sums, finite


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
