"""Principal components of pin displacements: few numbers, each a pattern of all pins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_LEAST = 1e-6
"""Spreads below this share of the largest are rounding."""


@dataclass(frozen=True, eq=False)
class Components:
    """Principal components of displacements."""

    mean: Array
    """(2 P,) displacement, px."""
    basis: Array
    """(2 P, K) orthonormal."""
    spread: Array
    """(K,) standard deviations over the frames of the fit, px, descending."""

    @classmethod
    def fit(cls, moved: Array, count: int) -> Self:
        """Return the first ``count`` components with any spread of displacements (N, 2 P)."""
        mean = moved.mean(axis=0)
        centred = moved - mean
        variance, basis = np.linalg.eigh(centred.T @ centred / len(moved))
        spread = np.sqrt(np.maximum(variance[::-1], 0.0))
        there = max(1, int(np.count_nonzero(spread[:count] > _LEAST * spread[0])))
        return cls(mean, np.ascontiguousarray(basis[:, ::-1][:, :there]), spread[:there])

    def __len__(self) -> int:
        return len(self.spread)

    def first(self, count: int) -> Self:
        """Return the first ``count`` components."""
        return type(self)(self.mean, self.basis[:, :count], self.spread[:count])

    def weights(self, whitening: float) -> Array:
        """Return (K,) 1 / spread^whitening: 0 keeps pixels, 1 makes all spread alike."""
        least = np.maximum(self.spread, 1e-9)
        return np.asarray((least / least[0]) ** -whitening / least[0], dtype=np.float64)

    def of(self, moved: Array, whitening: float) -> Array:
        """Return (N, K) of displacements (N, 2 P), the first with unit spread."""
        return np.asarray((moved - self.mean) @ self.basis * self.weights(whitening))
