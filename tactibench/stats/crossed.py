"""Differences of models that were trained on several seeds and answered the same presses.

A mean over presses and seeds varies for two reasons: other presses, and other seeds. No bootstrap
of an array of presses by seeds is exact (McCullagh 2000, Bernoulli 6:285), and resampling three
seeds finds only two thirds of their variance. So the two variances are estimated separately and
added, which is the variance of a crossed array without its last term. This errs on the safe side:
the interaction of presses and seeds is counted twice (Owen 2007, Annals of Applied Statistics
1:386). The sum has the degrees of freedom of Welch and Satterthwaite (Welch 1947). These can be
more than the few of the seeds, so a test with the seeds alone is made, too, and the wider of the
two decides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import stdtr, stdtrit  # scipy.stats takes a second to import

from tactibench.stats.clusters import FloatArray
from tactibench.stats.paired import holm

Term = tuple[FloatArray, FloatArray]
"""Variances of differences, and the degrees of freedom with which each was estimated."""


def crossed_p_values(
    difference: FloatArray,
    press_variance: FloatArray,
    presses: FloatArray,
    seed_variance: FloatArray,
    seeds: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return two-sided p values of every pair of K models, of presses alone and with seeds.

    Args:
        difference: (K, K), row minus column.
        press_variance: (K, K) variance of the difference over other presses.
        presses: (K, K) number of presses behind the difference.
        seed_variance: (K,) variance of a model's mean over other seeds; 0 where a training draws
            no random numbers.
        seeds: (K,) number of seeds.

    Returns:
        (K, K) p values that count presses alone, and (K, K) that count seeds as well.
    """
    freedom = np.maximum(seeds - 1.0, 1.0)
    of_columns = np.broadcast_to(seed_variance, difference.shape)
    free = np.broadcast_to(freedom, difference.shape)
    of_seeds: list[Term] = [(of_columns.T, free.T), (of_columns, free)]
    of_presses: list[Term] = [(press_variance, np.maximum(presses - 1.0, 1.0))]
    return welch_p_values(difference, of_presses), np.maximum(
        welch_p_values(difference, of_seeds),
        welch_p_values(difference, [*of_seeds, *of_presses]),
    )


def crossed_interval(
    difference: float,
    of_presses: tuple[float, float],
    of_seeds: Sequence[tuple[float, float]],
    level: float,
) -> tuple[float, float]:
    """Return the interval of a difference of two models, the wider of seeds alone and of both.

    Args:
        difference: Difference of the means.
        of_presses: Variance over other presses, and its degrees of freedom.
        of_seeds: The same over other seeds of each model; () where no training draws random
            numbers.
        level: Share of such intervals that hold the true difference.
    """
    half = max(_half_width(of_seeds, level), _half_width([*of_seeds, of_presses], level))
    return difference - half, difference + half


def _half_width(terms: Sequence[tuple[float, float]], level: float) -> float:
    variance = sum(variance for variance, _ in terms)
    if variance == 0:
        return 0.0
    freedom = variance**2 / sum(variance**2 / freedom for variance, freedom in terms)
    return float(stdtrit(freedom, (1 + level) / 2)) * math.sqrt(variance)


def welch_p_values(difference: FloatArray, terms: Sequence[Term]) -> FloatArray:
    """Return two-sided p values of differences whose variance is a sum of independent estimates.

    Without any variance p is 1 for a difference of 0, and 0 for every other difference.

    Args:
        difference: Any shape.
        terms: Estimates that are added, each of the shape of ``difference``.
    """
    zero = np.zeros_like(difference)
    variance = sum((variance for variance, _ in terms), zero)
    spread = sum((variance**2 / freedom for variance, freedom in terms), zero)
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = variance**2 / spread
        p = 2 * stdtr(freedom, -np.abs(difference) / np.sqrt(variance))
    certain = np.where(difference == 0, 1.0, 0.0)
    return np.where(spread > 0, p, certain)


def adjust_pairs(p: FloatArray) -> FloatArray:
    """Return symmetric (K, K) p values, adjusted for the family of all pairs (Holm 1979)."""
    upper = np.triu_indices(len(p), 1)
    adjusted = np.ones_like(p)
    if len(upper[0]):
        adjusted[upper] = holm(p[upper].tolist())
    return np.minimum(adjusted, adjusted.T)
