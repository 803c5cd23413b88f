"""Transfer to another sensor: fields that differ smoothly, and a correction of answers.

A simulated and a real sensor, or two of one make, differ even on the common lattice: the camera
sits askew, the skin yields unevenly, the plate drags it otherwise. No list of causes is complete,
so a model is shown every training field v with a smooth random difference e in proportion to it
(``Differences``):

    v + rms(v) e(x),    cov(e(x), e(x')) = sum over l of share^2 exp(-|x - x'|^2 / (2 l^2))

It then relies on what many pins say together. Without it, fields that no training press has look
far from all of them, and answers fall back to the middle of the range.

A few labelled frames of the other sensor correct a trained model's answers (``Correction``). The
model sees the frames as features h (its last hidden layer, or its kernel). The correction is a
ridge regression of the answers' errors,

    y - f(x) = c + w h(x),    |w|^2 ridge + sum of squares least,

which vanishes where the ridge is large. The ridge is chosen for every target alone: the largest one
whose mean absolute error of leaving one frame out is within one standard error of the least
(Breiman et al. 1984), so that ten frames correct little that they do not show clearly. A ridge
regression has these errors in closed form: with G = (K + ridge I)^-1 and alpha = G r the mean
absolute error is mean |alpha_i / G_ii| (Rasmussen and Williams 2006, eq. 5.12).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

RIDGES = tuple(float(ridge) for ridge in 10.0 ** np.arange(-4, 3.1, 0.5))
"""Ridges to try, as shares of the mean diagonal of the features' kernel, which is 1."""


LENGTHS = (0.15, 0.3, 0.6, 1.2)
"""Lengths of the differences, in units of the layout: from the pitch of the pins to the whole
sensor."""
SHARE = 0.06
"""Share of a field that differs at each length, 0.12 together. Simulated plates of a calibrated
sensor differ from the real ones by 0.13 to 0.18. It was chosen on the presses of the
calibrations."""
_JITTER = 1e-6
"""Addition to the covariance's diagonal, because long lengths make the covariance singular."""


@dataclass(frozen=True, eq=False)
class Differences:
    """Smooth random differences of fields on L points.

    Attributes:
        factor: (L, L) lower triangle whose product with its transpose is the covariance, of x and
            of y alike, for fields of unit root mean square.
    """

    factor: Array

    @classmethod
    def on(cls, points: Array, share: float = SHARE) -> Self:
        """Return the differences on points.

        Args:
            points: (L, 2) points, units of the layout.
            share: Share of a field that differs at each length.
        """
        square = np.square(points[:, None] - points).sum(axis=-1)
        covariance = sum(np.exp(-0.5 * square / length**2) for length in LENGTHS)
        return cls(share * np.linalg.cholesky(covariance + _JITTER * np.eye(len(points))))

    def add(self, moved: Array, rng: np.random.Generator) -> Array:
        """Return fields with a random difference in each.

        Args:
            moved: (N, 2 L) fields, x of all points before y.
            rng: Generator that draws the differences.
        """
        white = rng.standard_normal((2, len(moved), len(self.factor)))
        rms = np.sqrt(np.square(moved).mean(axis=1, keepdims=True))
        return np.asarray(moved + rms * np.concatenate([*(white @ self.factor.T)], axis=1))

    def of_components(self, basis: Array) -> Array:
        """Return the factor (K, K) of the differences in the components of a basis (2 L, K)."""
        half = len(self.factor)
        parts = np.concatenate([self.factor.T @ basis[:half], self.factor.T @ basis[half:]])
        # R of Q R has the covariance of the parts: R' R = parts' parts.
        triangle: Array = np.linalg.qr(parts)[1]
        return np.asarray(triangle.T)


@dataclass(frozen=True, eq=False)
class Correction:
    """A correction of T targets by n labelled frames.

    Attributes:
        features: (n, F) features of the frames, centred and scaled.
        alpha: (n, T) weights of the frames.
        middle: (F,) mean of the features.
        scale: Root mean square of the centred features.
        ridges: Ridge of every target.
    """

    features: Array
    alpha: Array
    middle: Array
    scale: float
    ridges: tuple[float, ...]

    @classmethod
    def fit(cls, features: Array, lacking: Array) -> Self:
        """Return the correction for labelled frames.

        Args:
            features: (n, F) features of the frames, n > 0.
            lacking: (n, T) targets less answers.
        """
        middle = features.mean(axis=0)
        centred = features - middle
        scale = max(float(np.sqrt(np.square(centred).sum(axis=1).mean())), 1e-12)
        places = centred / scale
        values, vectors = np.linalg.eigh(1.0 + places @ places.T)
        chosen = [_choose_ridge(values, vectors, column) for column in lacking.T]
        alpha = np.stack([alpha for _, _, alpha in chosen], axis=1)
        return cls(places, alpha, middle, scale, tuple(ridge for _, ridge, _ in chosen))

    def __call__(self, features: Array) -> Array:
        """Return (N, T) numbers to add to the answers of features (N, F)."""
        places = (features - self.middle) / self.scale
        return np.asarray((1.0 + places @ self.features.T) @ self.alpha, dtype=np.float64)


def _choose_ridge(values: Array, vectors: Array, lacking: Array) -> tuple[float, float, Array]:
    """Return error, ridge and alpha of the largest ridge that is about as good as the best.

    Args:
        values: (n,) eigenvalues of the frames' kernel.
        vectors: (n, n) eigenvectors of the kernel, one a column.
        lacking: (n,) one target less its answers.
    """
    candidates, scatters = [], []
    for ridge in RIDGES:
        inverse = (vectors / (np.maximum(values, 0.0) + ridge)) @ vectors.T
        alpha = inverse @ lacking
        errors = np.abs(alpha / np.diag(inverse))
        candidates.append((float(errors.mean()), ridge, alpha))
        scatters.append(float(errors.std() / np.sqrt(len(errors))))
    best = min(range(len(RIDGES)), key=lambda number: candidates[number][0])
    most = candidates[best][0] + scatters[best]
    return max((c for c in candidates if c[0] <= most), key=lambda candidate: candidate[1])
