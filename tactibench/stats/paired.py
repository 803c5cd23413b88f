"""Two models on the same presses: permutation test, Holm's adjustment, groups of equal rank."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from tactibench.stats.clusters import FloatArray, finite

BLOCK = 2**21
"""Random signs drawn at once, to bound the memory."""


def sign_flip_p(
    differences: npt.ArrayLike, *, rng: np.random.Generator, permutations: int = 9999
) -> float:
    """Return p = (1 + #{|sum s_i d_i| >= |sum d_i|}) / (1 + permutations), s_i random signs.

    The + 1 counts the data as one of the permutations (Phipson and Smyth 2010), so p is never 0.

    Args:
        differences: (G,) differences d of the two models, one per press.
        rng: Random numbers of the signs.
        permutations: Number of random permutations.
    """
    return float(_flipped(finite(differences, "differences"), rng, permutations))


def sign_flip_ps(
    differences: npt.ArrayLike, *, rng: np.random.Generator, permutations: int = 9999
) -> list[float]:
    """Return ``sign_flip_p`` of every column of (G, K) differences; all columns share their signs.

    A press that has no difference in a column should be 0 there: its sign then changes nothing.

    Raises:
        ValueError: The differences are no (G, K) array, or one of them is not finite.
    """
    d = finite(differences, "differences")
    if d.ndim != 2:
        raise ValueError(f"differences have shape {d.shape}, expected (G, K)")
    return [float(p) for p in _flipped(d, rng, permutations)]


def _flipped(d: FloatArray, rng: np.random.Generator, permutations: int) -> FloatArray:
    # a permutation that ties with the data must count in spite of rounding
    observed = np.abs(d.sum(axis=0)) - 1e-12 * np.abs(d).sum(axis=0)
    rows = max(1, BLOCK // max(1, len(d)))
    extreme = np.zeros(d.shape[1:])
    for start in range(0, permutations, rows):
        size = (min(rows, permutations - start), len(d))
        signs = 2.0 * rng.integers(2, size=size, dtype=np.int8) - 1.0
        extreme += (np.abs(signs @ d) >= observed).sum(axis=0)
    return np.asarray((1 + extreme) / (1 + permutations), dtype=np.float64)


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


def grouped(
    order: Sequence[int], worse: Callable[[int, Sequence[int]], set[int]]
) -> dict[int, int]:
    """Return the rank of every model of ``order``, the best first.

    The first model that is left opens a group, and all that are not worse join it. The next group's
    rank counts the models before it (1, 1, 3).

    Args:
        order: Numbers of the models.
        worse: Function of a model and a list of others. It returns those of them that are worse
            than the model.
    """
    ranks: dict[int, int] = {}
    left = list(order)
    while left:
        behind = worse(left[0], left[1:])
        ranks |= dict.fromkeys((m for m in left if m not in behind), 1 + len(ranks))
        left = [m for m in left if m in behind]
    return ranks
