"""Further training presses of a sensor of channels, made from the presses that there are.

A skin is pressed at few places, and its channels depend smoothly on place and depth. A Gaussian
process learns this dependence f from the training presses. Press i is then moved from its targets
y_i to others nearby,

    c = f(y) + e_i,    e_i = c_i - f_i(y_i),

where f_i is learned without press i and without the others at its place. So the networks see places
between those of the training, with the errors of real presses: the skin yields differently from
press to press, which changes several channels together. Noise of every channel alone leaves that
out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Self

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

Array = npt.NDArray[np.float64]

COPIES = 8
"""Moved presses for each press. With 16 the training takes twice as long, and the error on a fifth
of the training places of eFlesh is 3 % less."""
REACH = 0.5
"""Most that a press is moved along each target, in the target's deviation over the presses.
A quarter, or any place of the range, is worse on a fifth of the training places of eFlesh; 0.8 is
as good."""
_MOST = 4000
"""Most presses that are learned from. The time grows with the third power of their number and is
seconds for this many."""
_SAMPLE = 1600
"""Most presses on which lengths and noise are chosen; fewer lie farther apart and favour more
noise."""
_LENGTHS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0, 8.0)
"""Lengths of the kernel to try, in a target's deviation."""
_NOISES = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 1e-1)
"""Variances of the noise to try, as shares of the variance of f."""
_ROUNDS = 2
"""Passes over lengths and noise, each tried at the best of the others."""
_BATCH = 1000


@dataclass(frozen=True, eq=False)
class ForwardModel:
    """Gaussian process from T targets to C channels, with a Matern kernel of order 5/2.

    Attributes:
        targets: (N, T) targets of the presses, each divided by its length.
        lengths: (T,) lengths of the kernel.
        alpha: (N, C) weights of the presses.
        mean: (C,) mean channels.
        residuals: (N, C) channels less those predicted from the presses at other places.
    """

    targets: Array
    lengths: Array
    alpha: Array
    mean: Array
    residuals: Array

    @classmethod
    def fit(cls, targets: Array, moved: Array, places: npt.NDArray[np.intp]) -> Self:
        """Return the process that is fitted to presses.

        Args:
            targets: (N, T) targets.
            moved: (N, C) channels.
            places: (N,) number of the place of every press.
        """
        mean = moved.mean(axis=0)
        step = -(-len(moved) // _SAMPLE)
        lengths, noise = _choose_kernel(targets[::step], (moved - mean)[::step])
        scaled = targets / lengths
        inverse = cho_solve(_factor(scaled, noise), np.eye(len(scaled)))
        alpha = inverse @ (moved - mean)
        residuals = np.empty_like(moved)
        for place in np.unique(places):
            # Rasmussen and Williams 2006, eq. 5.12, for several presses at once.
            rows = np.flatnonzero(places == place)
            residuals[rows] = np.linalg.solve(inverse[np.ix_(rows, rows)], alpha[rows])
        return cls(scaled, lengths, alpha, mean, residuals)

    def __call__(self, targets: Array) -> Array:
        """Return the channels (M, C) of targets (M, T)."""
        starts = range(0, len(targets), _BATCH)  # a kernel of all rows would fill the memory
        rows = (targets[start : start + _BATCH] / self.lengths for start in starts)
        return np.concatenate([_kernel(row, self.targets) @ self.alpha for row in rows]) + self.mean


def move_presses(targets: Array, moved: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return targets and channels of COPIES moved presses for each one.

    Args:
        targets: (N, T) targets in deviations; a moved press stays within their range.
        moved: (N, C) channels.
        rng: Generator that draws the moves.
    """
    if len(targets) > _MOST:
        rows = np.sort(rng.permutation(len(targets))[:_MOST])
        targets, moved = targets[rows], moved[rows]
    # The first two targets of a contact are its place; presses of one place err alike. A plate has
    # no further targets, so that each of its presses is left out alone.
    _, places = np.unique(targets[:, :2], axis=0, return_inverse=True)
    forward = ForwardModel.fit(targets, moved, places.reshape(-1))
    low, high = targets.min(axis=0), targets.max(axis=0)
    new_targets, new_moved = [], []
    for _ in range(COPIES):
        nearby = targets + rng.uniform(-REACH, REACH, targets.shape)
        nearby = np.where(nearby < low, 2 * low - nearby, nearby)
        nearby = np.where(nearby > high, 2 * high - nearby, nearby).clip(low, high)
        new_targets.append(nearby)
        new_moved.append(forward(nearby) + forward.residuals)
    return np.concatenate(new_targets), np.concatenate(new_moved)


def _choose_kernel(targets: Array, moved: Array) -> tuple[Array, float]:
    """Return lengths (T,) and noise of the greatest marginal likelihood.

    Args:
        targets: (N, T) targets in deviations.
        moved: (N, C) channels less their mean.
    """
    count = targets.shape[1]
    choices = [*([_LENGTHS] * count), _NOISES]
    best = np.array([1.0] * count + [1e-3])
    least = np.inf
    for _, (number, values) in product(range(_ROUNDS), enumerate(choices)):
        for value in values:
            candidate = best.copy()
            candidate[number] = value
            loss = _unlikelihood(targets / candidate[:-1], moved, candidate[-1])
            if loss < least:
                least, best = loss, candidate
    return best[:-1], float(best[-1])


def _unlikelihood(targets: Array, moved: Array, noise: float) -> float:
    """Return -2 / C times the log likelihood with the best variance of f, up to a constant.

    Rasmussen and Williams 2006, eq. 2.30, for C channels of one kernel.
    """
    factor = _factor(targets, noise)
    variance = float(np.mean(moved * cho_solve(factor, moved)))
    determinant = 2.0 * float(np.log(np.diag(factor[0])).sum())
    return len(moved) * math.log(max(variance, 1e-300)) + determinant


def _factor(targets: Array, noise: float) -> tuple[Array, bool]:
    gram = _kernel(targets, targets)
    gram[np.diag_indices(len(gram))] += noise
    factor: tuple[Array, bool] = cho_factor(gram, lower=True, overwrite_a=True)
    return factor


def _kernel(a: Array, b: Array) -> Array:
    """Return the kernel (N, M) of targets (N, T) and (M, T), each divided by its length."""
    distance = np.sqrt(5.0) * cdist(a, b)
    return np.asarray((1.0 + distance + distance**2 / 3.0) * np.exp(-distance))
