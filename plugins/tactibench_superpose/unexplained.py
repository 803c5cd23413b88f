"""What fields of single presses that add up leave of several contacts, and how likely it is.

Contacts shift and weaken each other, so that superposed fields leave far more than the camera's
noise of every press with several. What they leave looks alike from press to press. Measured by its
covariance, a further contact that only takes what is always left is worth nothing, and a faint one
that is really there is worth much.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

FEWEST = 300
"""Presses with several contacts from which a covariance is learned."""


@dataclass(frozen=True, eq=False)
class Unexplained:
    """covariance: (Q, Q) of what is left, in standard deviations of the noise; (0, 0): unknown.
    scale: (Q,) from px to those."""

    covariance: Array
    scale: Array

    @classmethod
    def unknown(cls, weight: Array) -> Self:
        """Nothing is known. weight: (Q,) 1 / variance of the noise, 1 / px^2."""
        return cls(np.empty((0, 0)), np.sqrt(weight))

    @classmethod
    def learn(cls, left: Array, weight: Array) -> Self:
        """From what the right contacts leave of presses (N, Q) px; weight (Q,) of noise, 1 / px^2.

        No direction is taken to be known better than the noise lets it.
        """
        if len(left) < FEWEST:
            return cls.unknown(weight)
        scaled = left * np.sqrt(weight)
        variances, axes = np.linalg.eigh(scaled.T @ scaled / len(scaled))
        return cls((axes * np.maximum(variances, 1.0)) @ axes.T, np.sqrt(weight))

    @property
    def known(self) -> bool:
        """Whether there were presses to learn from."""
        return bool(self.covariance.size)

    def whitener(self, sure: Flags) -> Array:
        """(Q, M) that makes what is left of the pins that are sure (P,) independent, of variance 1.

        M is twice the number of these pins.
        """
        return self._of_all if sure.all() else self._of(np.flatnonzero(np.tile(sure, 2)))

    @cached_property
    def _of_all(self) -> Array:
        return self._of(np.arange(len(self.scale)))

    def _of(self, rows: npt.NDArray[np.intp]) -> Array:
        lower = np.linalg.cholesky(self.covariance[np.ix_(rows, rows)])
        whitener = np.zeros((len(self.scale), len(rows)))
        whitener[rows] = self.scale[rows, None] * np.linalg.inv(lower).T
        return whitener
