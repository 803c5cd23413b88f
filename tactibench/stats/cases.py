"""A mean against a reference mean over the same presses, and where along an axis it doubles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactibench.stats.clusters import Labels, cluster_codes, cluster_sums, finite
from tactibench.stats.intervals import Estimate, t_quantile

DOUBLE = 2.0
"""The error of a hard case counts as broken down when it is this many times the easy one."""


def mean_ratio(
    values: npt.ArrayLike,
    clusters: Labels,
    reference: npt.ArrayLike,
    reference_clusters: Labels,
    *,
    level: float = 0.95,
) -> Estimate:
    """Return r = mean(values) / mean(reference), both positive, with an interval on the log scale.

    Linearised: log r - log rho ~ sum over clusters g of
    u_g = sum_{i in g} (a_i - A) / (n_a A) - sum_{j in g} (b_j - B) / (n_b B),
    so that a press that occurs in both counts once, as the pair that it is;
    var = G / (G - 1) sum u_g^2, t quantile of G - 1 (Liang and Zeger 1986, delta method).
    No value where the reference is 0, no interval where either mean is.

    Raises ValueError for values that are not finite, and for labels that are not one to a value.
    """
    a, b = finite(values, "values"), finite(reference, "reference")
    if not len(a) or not len(b) or b.mean() == 0:
        return Estimate(None, None, None, len(a), 0)
    both = np.concatenate([np.asarray(clusters), np.asarray(reference_clusters)])
    codes, count = cluster_codes(both, len(a) + len(b))
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
    """First value at which the polygon through (value, ratio) reaches ``level``, from below.

    values: from easy to hard, rising or falling. None: it does not, or a ratio before is unknown.
    """
    known = list(zip(values, ratios, strict=True))
    for (x0, y0), (x1, y1) in pairwise(known):
        if y0 is None or y1 is None:
            return None
        if y0 >= level:
            return x0
        if y1 >= level:
            return x0 + (x1 - x0) * (level - y0) / (y1 - y0)
    return None


def doubling(easy: float, values: Sequence[float], ratios: Sequence[Estimate]) -> Estimate:
    """Return the value at which a ratio to the easy case, which is 1 there, reaches 2.

    Linear between the values. The interval holds the values at which the upper and the lower ends
    of the ratios' intervals reach 2; an end that is not reached is None. Censored at the hardest
    value, ">" where harder rises and "<" where it falls, when the ratio stays below 2.
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
