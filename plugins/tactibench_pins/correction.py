"""The correction of a trained model's answers by a few labelled frames of another sensor.

The trained model sees the frames as features h (its last hidden layer, or its kernel). The
correction is a ridge regression of the answers' errors,

    y - f(x) = c + w h(x),    |w|^2 ridge + sum of squares least,

which is nothing where the ridge is large. The ridge is chosen for every target alone, by the mean
absolute error of leaving one frame out, which a ridge regression knows in closed form: with
G = (K + ridge I)^-1 and alpha = G r it is mean |alpha_i / G_ii| (Rasmussen and Williams 2006,
eq. 5.12).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

RIDGES = tuple(float(ridge) for ridge in 10.0 ** np.arange(-4, 3.1, 0.5))
"""Shares of the kernel's mean diagonal, which is 1."""


@dataclass(frozen=True, eq=False)
class Correction:
    """alpha: (n, T) of n labelled frames, features (n, F) of them. middle, scale: of features.

    ridges: chosen, of every target.
    """

    features: Array
    alpha: Array
    middle: Array
    scale: float
    ridges: tuple[float, ...]

    @classmethod
    def fit(cls, features: Array, lacking: Array) -> Self:
        """features: (n, F), n > 0. lacking: (n, T) what the answers should have been more."""
        middle = features.mean(axis=0)
        centred = features - middle
        scale = max(float(np.sqrt(np.square(centred).sum(axis=1).mean())), 1e-12)
        places = centred / scale
        values, vectors = np.linalg.eigh(1.0 + places @ places.T)
        chosen = [_choose_ridge(values, vectors, column) for column in lacking.T]
        alpha = np.stack([alpha for _, _, alpha in chosen], axis=1)
        return cls(places, alpha, middle, scale, tuple(ridge for _, ridge, _ in chosen))

    def __call__(self, features: Array) -> Array:
        """(N, T) to be added to the answers."""
        places = (features - self.middle) / self.scale
        return np.asarray((1.0 + places @ self.features.T) @ self.alpha, dtype=np.float64)


def _choose_ridge(values: Array, vectors: Array, lacking: Array) -> tuple[float, float, Array]:
    """(error, ridge, alpha) of the ridge with the least error of leaving one frame out."""
    candidates = []
    for ridge in RIDGES:
        inverse = (vectors / (np.maximum(values, 0.0) + ridge)) @ vectors.T
        alpha = inverse @ lacking
        candidates.append((float(np.abs(alpha / np.diag(inverse)).mean()), ridge, alpha))
    return min(candidates, key=lambda candidate: candidate[:2])
