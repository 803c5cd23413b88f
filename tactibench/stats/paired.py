"""Models on the same presses: permutation test, adjusted p values, several seeds.

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

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.special import stdtr  # scipy.stats takes a second to import

from tactibench.stats.intervals import FloatArray, finite

BLOCK = 2**21
"""Random signs drawn at once, to bound the memory."""


def sign_flip_ps(
    differences: npt.ArrayLike, *, rng: np.random.Generator, permutations: int = 9999
) -> list[float]:
    """Return p = (1 + #{|sum s_i d_i| >= |sum d_i|}) / (1 + permutations) of every column.

    The + 1 counts the data as one of the permutations (Phipson and Smyth 2010), so p is never 0. A
    press that has no difference in a column should be 0 there: its sign then changes nothing.

    Args:
        differences: (G, K) differences d of two models, a row a press; all columns share the random
            signs s.
        rng: Random numbers of the signs.
        permutations: Number of random permutations.

    Raises:
        ValueError: A difference is not finite.
    """
    d = finite(differences, "differences")
    # a permutation that ties with the data must count in spite of rounding
    observed = np.abs(d.sum(axis=0)) - 1e-12 * np.abs(d).sum(axis=0)
    rows = max(1, BLOCK // max(1, len(d)))
    extreme = np.zeros(d.shape[1:])
    for start in range(0, permutations, rows):
        size = (min(rows, permutations - start), len(d))
        signs = 2.0 * rng.integers(2, size=size, dtype=np.int8) - 1.0
        extreme += (np.abs(signs @ d) >= observed).sum(axis=0)
    return [float(p) for p in (1 + extreme) / (1 + permutations)]


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p values, adjusted for a family by Holm's step-down method (1979), in their order.

    The adjusted values are monotone in the p values and at most 1.
    """
    p = finite(p_values, "p values")
    order = np.argsort(p, kind="stable")
    steps = p[order] * np.arange(len(p), 0, -1)
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return [float(x) for x in adjusted]


Term = tuple[FloatArray, FloatArray]
"""Variances of differences, and the degrees of freedom with which each was estimated."""


def crossed_p_values(
    difference: FloatArray,
    press_variance: FloatArray,
    presses: FloatArray,
    seed_variance: FloatArray,
    seeds: FloatArray,
) -> FloatArray:
    """Return two-sided p values of every pair of K models, (K, K), that count presses and seeds.

    Args:
        difference: (K, K), row minus column.
        press_variance: (K, K) variance of the difference over other presses.
        presses: (K, K) number of presses behind the difference.
        seed_variance: (K,) variance of a model's mean over other seeds; 0 where a training draws
            no random numbers.
        seeds: (K,) number of seeds.
    """
    freedom = np.maximum(seeds - 1.0, 1.0)
    of_columns = np.broadcast_to(seed_variance, difference.shape)
    free = np.broadcast_to(freedom, difference.shape)
    of_seeds: list[Term] = [(of_columns.T, free.T), (of_columns, free)]
    of_presses: list[Term] = [(press_variance, np.maximum(presses - 1.0, 1.0))]
    p: FloatArray = np.maximum(
        welch_p_values(difference, of_seeds),
        welch_p_values(difference, [*of_seeds, *of_presses]),
    )
    return p


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
    """Return symmetric (K, K) p values, adjusted for all pairs (Benjamini and Hochberg 1995).

    Of the pairs whose adjusted value is below q, a share of q is expected to be equal.
    """
    upper = np.triu_indices(len(p), 1)
    order = np.argsort(p[upper], kind="stable")[::-1]  # from the largest
    count = len(order)
    steps = p[upper][order] * count / np.arange(count, 0, -1)
    adjusted = np.ones_like(p)
    of_pairs = np.empty(count)
    of_pairs[order] = np.minimum.accumulate(np.minimum(steps, 1.0))
    adjusted[upper] = of_pairs
    return np.minimum(adjusted, adjusted.T)
