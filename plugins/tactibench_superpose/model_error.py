"""The error of superposed fields of single presses for several contacts, by its covariance.

Contacts shift and weaken each other, so that superposed fields leave a residual far beyond the
camera's noise. It looks alike from press to press. Measured by its covariance, a further contact
that only explains the usual residual is worth nothing, and a faint one that is really there much.
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
class ModelError:
    """The usual residual of presses with several contacts."""

    covariance: Array
    """(Q, Q), in standard deviations of the noise; (0, 0): unknown."""
    scale: Array
    """(Q,) from px to these."""

    @classmethod
    def unknown(cls, weight: Array) -> Self:
        """Return one without a covariance. weight: (Q,) 1 / variance of the noise, 1 / px^2."""
        return cls(np.empty((0, 0)), np.sqrt(weight))

    @classmethod
    def learn(cls, left: Array, weight: Array) -> Self:
        """Learn from residuals (N, Q) px of presses with their true contacts.

        No direction is taken to be known better than the noise allows. weight: (Q,) of the noise,
        1 / px^2.
        """
        if len(left) < FEWEST:
            return cls.unknown(weight)
        scaled = left * np.sqrt(weight)
        variances, axes = np.linalg.eigh(scaled.T @ scaled / len(scaled))
        return cls((axes * np.maximum(variances, 1.0)) @ axes.T, np.sqrt(weight))

    @property
    def learned(self) -> bool:
        """True if there were presses to learn from."""
        return bool(self.covariance.size)

    def whitener(self, sure: Flags) -> Array:
        """Return (Q, M) that makes residuals of the sure pins (P,) independent, of variance 1.

        M is twice the number of these pins.
        """
        return (
            self._whitener_of_all
            if sure.all()
            else self._whitener_of(np.flatnonzero(np.tile(sure, 2)))
        )

    @cached_property
    def _whitener_of_all(self) -> Array:
        return self._whitener_of(np.arange(len(self.scale)))

    def _whitener_of(self, rows: npt.NDArray[np.intp]) -> Array:
        lower = np.linalg.cholesky(self.covariance[np.ix_(rows, rows)])
        whitener = np.zeros((len(self.scale), len(rows)))
        whitener[rows] = self.scale[rows, None] * np.linalg.inv(lower).T
        return whitener
