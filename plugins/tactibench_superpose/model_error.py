"""The error of superposed fields of single presses for several contacts, by its covariance.

Contacts shift and weaken each other, so that superposed fields leave a residual far beyond the
camera's noise. It is similar from press to press. Measured by its covariance, a further contact
that only explains the usual residual is worth nothing, and a faint one that is really there is
worth much.
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
"""Least number of presses with several contacts from which a covariance is learned."""


@dataclass(frozen=True, eq=False)
class ModelError:
    """The usual residual of presses with several contacts.

    Attributes:
        covariance: (Q, Q) covariance, in standard deviations of the noise; (0, 0): unknown.
        scale: (Q,) factors from px to standard deviations of the noise.
    """

    covariance: Array
    scale: Array

    @classmethod
    def unknown(cls, weight: Array) -> Self:
        """Return a model error whose covariance is unknown.

        Args:
            weight: (Q,) 1 / variance of the noise, 1 / px^2.
        """
        return cls(np.empty((0, 0)), np.sqrt(weight))

    @classmethod
    def learn(cls, left: Array, weight: Array) -> Self:
        """Learn the covariance from residuals of presses explained by their true contacts.

        In no direction is the variance taken to be less than that of the noise. With fewer than
        FEWEST residuals the covariance stays unknown.

        Args:
            left: (N, Q) residuals, px.
            weight: (Q,) 1 / variance of the noise, 1 / px^2.
        """
        if len(left) < FEWEST:
            return cls.unknown(weight)
        scaled = left * np.sqrt(weight)
        variances, axes = np.linalg.eigh(scaled.T @ scaled / len(scaled))
        return cls((axes * np.maximum(variances, 1.0)) @ axes.T, np.sqrt(weight))

    @property
    def learned(self) -> bool:
        """True if there were enough presses to learn from."""
        return bool(self.covariance.size)

    def whitener(self, sure: Flags) -> Array:
        """Return the (Q, M) matrix that whitens residuals of the sure pins.

        It makes them independent, of variance 1. M is twice the number of these pins.

        Args:
            sure: (P,) whether a pin is sure.
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
