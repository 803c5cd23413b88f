"""Two models on the same presses: paired differences, permutation test, Holm, rank groups."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.stats.clusters import FloatArray, finite
from tactibench.stats.estimate import Estimate
from tactibench.stats.intervals import mean_interval

BLOCK = 2**21


@dataclass(frozen=True)
class PairedDifference:
    """First minus second, press by press. p: two-sided sign-flip permutation test."""

    difference: Estimate
    p: float | None


def paired_difference(
    first: npt.ArrayLike,
    second: npt.ArrayLike,
    *,
    rng: np.random.Generator,
    level: float = 0.95,
    permutations: int = 9999,
) -> PairedDifference:
    """Compare (G,) values of two models, one for each press, in the same order of presses."""
    a, b = finite(first, "first"), finite(second, "second")
    if a.shape != b.shape or a.ndim != 1:
        raise ValueError(f"paired values have shapes {a.shape} and {b.shape}")
    d = a - b
    p = sign_flip_p(d, rng=rng, permutations=permutations) if len(d) > 1 else None
    return PairedDifference(mean_interval(d, np.arange(len(d)), level=level), p)


def sign_flip_p(
    differences: npt.ArrayLike, *, rng: np.random.Generator, permutations: int = 9999
) -> float:
    """p = (1 + #{|sum s_i d_i| >= |sum d_i|}) / (1 + permutations), s_i random signs.

    The + 1 counts the data as one of the permutations (Phipson and Smyth 2010): p is never 0.
    """
    return float(_flipped(finite(differences, "differences"), rng, permutations))


def sign_flip_ps(
    differences: npt.ArrayLike, *, rng: np.random.Generator, permutations: int = 9999
) -> list[float]:
    """``sign_flip_p`` of every column of (G, K) differences; all columns share their signs.

    A press that has no difference in a column is 0 there: its sign changes nothing.
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
    """Adjust p values for a family (Holm 1979): step down, monotone, at most 1. Keeps the order."""
    p = finite(p_values, "p values")
    order = np.argsort(p, kind="stable")
    steps = p[order] * np.arange(len(p), 0, -1)
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return [float(x) for x in adjusted]


def rank_groups(values: npt.ArrayLike, *, better: str = "lower", level: float = 0.95) -> list[int]:
    """Rank (M, G) values of M models on G presses in groups.

    Models whose paired interval against the best contains 0 share its rank; the best of the rest
    opens the next group, whose rank counts the models before it (1, 1, 3).
    """
    table = finite(values, "values")
    if better not in {"lower", "higher"}:
        raise ValueError(f"better is {better!r}, it must be 'lower' or 'higher'")
    cost = table if better == "lower" else -table
    order = sorted(range(len(cost)), key=lambda m: float(cost[m].mean()))
    found = grouped(order, lambda m, best: _worse(cost[m] - cost[best], level))
    return [found[m] for m in range(len(cost))]


def grouped(order: Sequence[int], worse: Callable[[int, int], bool]) -> dict[int, int]:
    """Rank of every model of ``order``, best first, by whether it is told to be ``worse``.

    The first of those that are left opens a group, all that are not worse than it join, and the
    next group's rank counts the models before it (1, 1, 3).
    """
    ranks: dict[int, int] = {}
    left = list(order)
    while left:
        tied = [left[0], *(m for m in left[1:] if not worse(m, left[0]))]
        ranks |= dict.fromkeys(tied, 1 + len(ranks))
        left = [m for m in left if m not in tied]
    return ranks


def _worse(difference: FloatArray, level: float) -> bool:
    """Whether the interval of the mean difference lies above 0; one press cannot tell."""
    low = mean_interval(difference, np.arange(len(difference)), level=level).low
    return low is not None and low > 0
