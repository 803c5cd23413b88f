"""The residual of the law of ``neighbours`` for two contacts, learned from pairs.

The law is a polynomial; its residual is smooth, small and the same for pairs with the same
features. It is kriged over these five features, in the frame of the pair. A mirrored pair has the
mirrored residual, so along the pair and in depth the kernel is even in the place beside the pair,
and across the pair it is odd.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.superposition.field import kriging, matern
from tactibench.superposition.neighbours import contact_pairs, recombined

Array = npt.NDArray[np.float64]

LENGTHS = (1.5, 2.0, 3.0)
"""Lengths of the kernel that are tried, in the features' scales."""
RIDGES = (3e-3, 1e-2, 3e-2, 1e-1)
"""Variances of noise relative to that of the residual that are tried."""
FEWEST = 100
"""Fewest pairs from which a residual is learned; with fewer it is zero."""
_MIRROR = np.array([1.0, 1.0, 1.0, 1.0, -1.0])
"""Signs of the features when a pair is mirrored at the line through both contacts."""
_ALONG, _ACROSS = [0, 2], [1]
"""Components of a shift in which the kernel is even, and in which it is odd."""
_HELD_OUT = 10
"""One pair in this many is held out to choose length and ridge."""
_FAR = 0.7
"""Distance from every training pair, in scales, beyond which the residual is held to zero."""
_HELD = 600
"""Approximate number of places at which the residual is held to zero."""
_OUTLIER = 6.0
"""Robust standard deviations beyond which the residual of a pair comes from a wrong detection."""


@dataclass(frozen=True, eq=False)
class Residual:
    """A kriged shift of two contacts.

    Attributes:
        features: (N, 5) features of the training.
        along: (N, 2) weights towards the neighbour and in depth.
        across: (N, 1) weights across the pair.
        length: Length of the kernel, in the features' scales.
    """

    features: Array
    along: Array
    across: Array
    length: float

    @classmethod
    def none(cls) -> Self:
        """Return the residual that is zero."""
        return cls(np.empty((0, 5)), np.empty((0, 2)), np.empty((0, 1)), LENGTHS[0])

    @classmethod
    def learn(cls, contacts: Array, left: Array) -> Self:
        """Learn the residual from pairs.

        Length and ridge are those that predict every tenth pair best. For pairs unlike all of the
        training, such as uneven pairs after level ones, the residual is zero.

        Args:
            contacts: (S, 2, 3) equivalents of pairs, mm.
            left: (S, 2, 3) their residual shifts, mm.
        """
        size = np.maximum(1.4826 * np.median(np.abs(left), axis=(0, 1)), 1e-6)
        usual = (np.abs(left) < _OUTLIER * size).all(axis=(1, 2))
        if np.count_nonzero(usual) < FEWEST:
            return cls.none()
        features, wanted = _samples(contacts[usual], left[usual])
        held = np.arange(features.shape[1]) % _HELD_OUT == 0
        far = _far_from(_flat(features), contacts[usual])
        nothing = np.zeros((len(far), 3))
        learned = np.concatenate([_flat(features[:, ~held]), far])
        shifts = np.concatenate([_flat(wanted[:, ~held]), nothing])
        tested, true = _flat(features[:, held]), _flat(wanted[:, held])
        choices = [(length, ridge) for length in LENGTHS for ridge in RIDGES]
        errors = [
            np.square(cls._fit(learned, shifts, length, ridge)._predict(tested) - true).sum()
            for length, ridge in choices
        ]
        best = choices[int(np.argmin(errors))]
        every = np.concatenate([_flat(features), far])
        return cls._fit(every, np.concatenate([_flat(wanted), nothing]), *best)

    @classmethod
    def _fit(cls, features: Array, wanted: Array, length: float, ridge: float) -> Self:
        same, mirrored = _kernels(features, features, length)
        along = kriging(same + mirrored, wanted[:, _ALONG], ridge)
        across = kriging(same - mirrored, wanted[:, _ACROSS], ridge)
        return cls(features, along, across, length)

    def shift(self, contacts: Array) -> Array:
        """Return the shifts to add to equivalents (S, K, 3), both in mm; zero unless K is 2."""
        out = np.zeros_like(contacts)
        if contacts.shape[1] == 2 and len(self.features):
            for pair in contact_pairs(contacts):
                out[:, pair.i] = pair.to_xy(self._predict(pair.features))
        return out

    def _predict(self, features: Array) -> Array:
        """Return the shifts towards, beside and in depth, (S, 3) mm, of features (S, 5)."""
        same, mirrored = _kernels(features, self.features, self.length)
        out = np.empty((len(features), 3))
        out[:, _ALONG] = (same + mirrored) @ self.along
        out[:, _ACROSS] = (same - mirrored) @ self.across
        return out


def _samples(contacts: Array, left: Array) -> tuple[Array, Array]:
    """Return (2, S, 5) features and (2, S, 3) residual shifts, in the frames of the pairs."""
    pairs = contact_pairs(contacts)
    wanted = [pair.from_xy(left[:, pair.i]) for pair in pairs]
    return np.stack([pair.features for pair in pairs]), np.stack(wanted)


def _far_from(features: Array, contacts: Array) -> Array:
    """Return the features of recombined pairs that are far from given features, (N, 5).

    Args:
        features: (M, 5) given features.
        contacts: (S, 2, 3) mm, pairs that are recombined.
    """
    from scipy.spatial import cKDTree

    anew = np.concatenate([pair.features for pair in contact_pairs(recombined(contacts))])
    far: Array = anew[cKDTree(features).query(anew)[0] > _FAR]
    return far[:: max(1, len(far) // _HELD)]


def _flat(values: Array) -> Array:
    return values.reshape(-1, values.shape[-1])


def _kernels(a: Array, b: Array, length: float) -> tuple[Array, Array]:
    """Return the kernels (M, N) between features, and between features and mirrored features."""
    return matern(a, b, length), matern(a, b * _MIRROR, length)
