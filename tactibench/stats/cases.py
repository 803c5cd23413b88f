"""Ratio of a mean to a reference mean over the same presses, and where along an axis it doubles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactibench.stats.clusters import Labels, cluster_codes, cluster_sums, finite
from tactibench.stats.intervals import Estimate, t_quantile

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
