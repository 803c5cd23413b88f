"""Measure what rank intervals promise: wrong splits, power and coverage, on invented boards.

    python benchmarks/rank_intervals.py [--boards 400] [--models 20] [--seed 0]

A board has models in groups of equal true error; from one group to the next the error grows by a
tenth. Each has three trainings, which scatter its error by a share that differs from model to
model (2 to 15 %), and 400 presses, which are as hard for one model as for another. Prints, for the
adjustment of Benjamini and Hochberg that boards use and for that of Holm:

* split: share of pairs called different that are equal;
* power: share of pairs whose errors differ by 30 % or more that are called different;
* coverage: share of models whose interval holds a place that their true error has.

Exit code 1 when, with the first adjustment, more than 5 % are split or fewer than 95 % covered, by
more than two standard errors over boards.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from tactibench.board import rank_intervals
from tactibench.stats import adjust_pairs, crossed_p_values, holm

PRESSES, SEEDS = 400, 3
STEP = 0.1
GROUP = 2
LARGE = 0.3


def board(rng: np.random.Generator, models: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the true log errors of models, and the differences and p values of one board.

    Args:
        rng: Random numbers of presses and trainings.
        models: Number of models.
    """
    true = np.log1p(STEP) * (np.arange(models) // GROUP)
    hard = rng.gamma(2.0, 1.0, PRESSES) + 0.2
    scatter = rng.uniform(0.02, 0.15, models)
    own = np.exp(rng.normal(0.0, 0.5, (models, 1, PRESSES)))  # what is hard for this model
    again = np.exp(rng.normal(0.0, 0.3, (models, SEEDS, PRESSES)))  # and for this training
    trained = np.exp(rng.normal(0.0, scatter[:, None], (models, SEEDS)))
    errors = np.exp(true)[:, None, None] * hard * own * again * trained[:, :, None]
    value = errors.mean(axis=(1, 2))
    relative = errors.mean(axis=1) / value[:, None]
    covariance = np.cov(relative) / PRESSES
    variance = np.diag(covariance)[:, None] + np.diag(covariance) - 2 * covariance
    seeds = (errors.mean(axis=2) / value[:, None]).var(axis=1, ddof=1) / SEEDS
    difference = np.log(value)[:, None] - np.log(value)
    counts = np.full(difference.shape, float(PRESSES))
    p = crossed_p_values(difference, variance, counts, seeds, np.full(models, float(SEEDS)))
    return true, difference, p


def measure(true: np.ndarray, difference: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return (wrong pairs, called pairs, found large pairs, large pairs, covered models).

    Args:
        true: (K,) true log errors.
        difference: (K, K) measured differences.
        p: (K, K) p values that ``rank_intervals`` adjusts.
    """
    upper = np.triu_indices(len(true), 1)
    called = (adjust_pairs(p) < 0.05)[upper]
    apart = np.abs(true[:, None] - true)[upper]
    large = apart > np.log1p(LARGE) - 1e-9
    first = 1 + (true[:, None] > true + 1e-9).sum(axis=1)
    last = (true[:, None] > true - 1e-9).sum(axis=1)
    intervals = rank_intervals(difference, p)
    pairs = zip(intervals, first, last, strict=True)
    covered = sum(got.best <= end and got.worst >= begin for got, begin, end in pairs)
    wrong = (called & (apart < 1e-9)).sum()
    return np.array([wrong, called.sum(), (called & large).sum(), large.sum(), covered])


def holm_pairs(p: np.ndarray) -> np.ndarray:
    """Return 0 for the pairs that Holm's adjustment calls different, 1 for the others."""
    upper = np.triu_indices(len(p), 1)
    found = np.ones_like(p)
    found[upper] = np.where(np.array(holm(p[upper].tolist())) < 0.05, 0.0, 1.0)
    both: np.ndarray = np.minimum(found, found.T)
    return both


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boards", type=int, default=400)
    parser.add_argument("--models", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    counts: dict[str, list[np.ndarray]] = {"Benjamini-Hochberg": [], "Holm": []}
    for _ in range(options.boards):
        true, difference, p = board(rng, options.models)
        counts["Benjamini-Hochberg"].append(measure(true, difference, p))
        counts["Holm"].append(measure(true, difference, holm_pairs(p)))
    print(f"{options.boards} boards of {options.models} models, {SEEDS} seeds, {PRESSES} presses")
    failed = False
    for name, each in counts.items():
        table = np.array(each, dtype=float)
        wrong, called, found, large, covered = table.T
        split = wrong.sum() / max(called.sum(), 1)
        coverage = covered / options.models
        error = coverage.std(ddof=1) / np.sqrt(len(coverage))
        split_error = (wrong / np.maximum(called, 1)).std(ddof=1) / np.sqrt(len(wrong))
        power, share = found.sum() / large.sum(), coverage.mean()
        print(
            f"{name:20} split {split:6.1%} +- {split_error:.1%}   power {power:6.1%}   "
            f"coverage {share:6.1%} +- {error:.1%}"
        )
        if name != "Holm":
            failed = split > 0.05 + 2 * split_error or share < 0.95 - 2 * error
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
