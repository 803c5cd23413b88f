"""The residual of the law of ``neighbours`` for two contacts, learned from pairs.

The law is a polynomial; its residual is smooth, small and the same for every pair that looks alike.
It is kriged over the same five features, in the frame of the pair. A mirrored pair has
the mirrored residual, so along the pair and in depth the kernel is even in the place beside it,
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
"""Lengths of the kernel, in the features' scales."""
RIDGES = (3e-3, 1e-2, 3e-2, 1e-1)
"""Variance of noise against that of the residual."""
FEWEST = 100
"""Pairs from which something is learned; with fewer the residual is taken as nothing."""
_MIRROR = np.array([1.0, 1.0, 1.0, 1.0, -1.0])
"""Signs of the features when a pair is mirrored at the line through both contacts."""
_ALONG, _ACROSS = [0, 2], [1]
_HELD_OUT = 10
"""One pair of so many is held out to choose length and ridge."""
_FAR = 0.7
"""Scales from every pair that was learned from, beyond which the residual is held to nothing."""
_HELD = 600
"""Places, about, at which it is held to nothing."""
_OUTLIER = 6.0
"""Robust standard deviations; a pair that is left with more was seen wrongly."""


@dataclass(frozen=True, eq=False)
class Residual:
    """A kriged shift of two contacts."""

    features: Array
    """(N, 5) features that were learned from."""
    along: Array
    """(N, 2) weights towards the neighbour and in depth."""
    across: Array
    """(N, 1) weights across the pair."""
    length: float
    """Length of the kernel."""

    @classmethod
    def none(cls) -> Self:
        """Return the residual that is zero."""
        return cls(np.empty((0, 5)), np.empty((0, 2)), np.empty((0, 1)), LENGTHS[0])

    @classmethod
    def learn(cls, contacts: Array, left: Array) -> Self:
        """Learn from equivalents of pairs (S, 2, 3) mm and their residual shifts (S, 2, 3) mm.

        Length and ridge are those that predict every tenth pair best. Among pairs unlike all of
        these, such as uneven ones after level ones, the residual is nothing.
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
        """Return (S, K, 3) mm to add to equivalents (S, K, 3); zero unless K is 2."""
        out = np.zeros_like(contacts)
        if contacts.shape[1] == 2 and len(self.features):
            for pair in contact_pairs(contacts):
                out[:, pair.i] = pair.to_xy(self._predict(pair.features))
        return out

    def _predict(self, features: Array) -> Array:
        """(S, 3) towards, beside, depth."""
        same, mirrored = _kernels(features, self.features, self.length)
        out = np.empty((len(features), 3))
        out[:, _ALONG] = (same + mirrored) @ self.along
        out[:, _ACROSS] = (same - mirrored) @ self.across
        return out


def _samples(contacts: Array, left: Array) -> tuple[Array, Array]:
    """(2, S, 5) features and (2, S, 3) residual shifts, in the frames of the pairs."""
    both = contact_pairs(contacts)
    wanted = [pair.from_xy(left[:, pair.i]) for pair in both]
    return np.stack([pair.features for pair in both]), np.stack(wanted)


def _far_from(features: Array, contacts: Array) -> Array:
    """(N, 5) features of pairs put together anew that are far from the given ones (M, 5)."""
    from scipy.spatial import cKDTree

    anew = np.concatenate([pair.features for pair in contact_pairs(recombined(contacts))])
    far: Array = anew[cKDTree(features).query(anew)[0] > _FAR]
    return far[:: max(1, len(far) // _HELD)]


def _flat(values: Array) -> Array:
    return values.reshape(-1, values.shape[-1])


def _kernels(a: Array, b: Array, length: float) -> tuple[Array, Array]:
    """(M, N) between features, and between those and the mirrored ones."""
    return matern(a, b, length), matern(a, b * _MIRROR, length)
