"""Transfer to another sensor: views of displacement fields, and a correction of answers.

On the common lattice two sensors of one make still differ: the camera sits askew, the layout's
outline is read a little too large or off the middle, the skin yields a little more. While a model
trains it is shown every frame through such differences, drawn at random (``draw_views``).

A few labelled frames of the other sensor correct a trained model's answers (``Correction``). The
model sees the frames as features h (its last hidden layer, or its kernel). The correction is a
ridge regression of the answers' errors,

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

from tactibench.markers import kriging_weights

Array = npt.NDArray[np.float64]

RIDGES = tuple(float(ridge) for ridge in 10.0 ** np.arange(-4, 3.1, 0.5))
"""Shares of the kernel's mean diagonal, which is 1."""


@dataclass(frozen=True)
class Spread:
    """Half-widths of uniform ranges, assumed.

    Attributes:
        turn_deg: Turn of the camera, deg.
        size: Share of the outline's size.
        stretch: Stretch of one axis against the other, a share.
        shift: Shift of the outline, units of the layout.
        gain: Share of the field.
    """

    turn_deg: float = 2.0
    size: float = 0.03
    stretch: float = 0.015
    shift: float = 0.03
    gain: float = 0.05


SPREAD = Spread()


def draw_views(
    points: Array, count: int, rng: np.random.Generator, spread: Spread = SPREAD
) -> tuple[Array, ...]:
    """Return ``count`` matrices (2 L, 2 L), the first of them one.

    Fields (N, 2 L) on the lattice times the transpose are the fields as seen by another sensor.

    With R a turn and D a stretch: v'(x) = gain R' v(D R x + shift), interpolated on the lattice.
    """
    views = [np.eye(2 * len(points))]
    while len(views) < count:
        turn, size, stretch, gain, *shift = rng.uniform(-1.0, 1.0, 6)
        angle = np.radians(spread.turn_deg * turn)
        rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        uneven = 1 + spread.stretch * stretch
        grown = (1 + spread.size * size) * np.array([uneven, 1 / uneven])
        seen = (points @ rotation.T) * grown + spread.shift * np.array(shift)
        weights = (1 + spread.gain * gain) * kriging_weights(points, seen)
        views.append(np.kron(rotation.T, weights))
    return tuple(views)


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
            features: (n, F), n > 0.
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
    """Return error, ridge and alpha where leaving one frame out has the least error."""
    candidates = []
    for ridge in RIDGES:
        inverse = (vectors / (np.maximum(values, 0.0) + ridge)) @ vectors.T
        alpha = inverse @ lacking
        candidates.append((float(np.abs(alpha / np.diag(inverse)).mean()), ridge, alpha))
    return min(candidates, key=lambda candidate: candidate[:2])
