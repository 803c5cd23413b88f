"""The standard deviations of fitted contacts: from noise, and from the model of several contacts.

    variance = floor^2 + (a noise)^2 + (b shift)^2 + (c misfit)^2

The noise is the deviation of the least-squares fit, mm, the shift the distance of a contact from
its equivalent, mm, and the misfit chi^2 per degree of freedom. There is one set of (floor, a, b, c)
for x and y and one for depth, of contacts alone, in pairs and in larger groups. For depth the noise
is that of x and y: what is left unexplained there is seldom the camera's noise.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
import numpy.typing as npt

from tactibench.superposition.compiled import hold_of
from tactibench.superposition.contact_fit import Found
from tactibench.superposition.field import CORRELATED

Array = npt.NDArray[np.float64]

GROUPS = 3
"""Number of groups: one contact, two, and three or more."""
_LARGEST_MM = 3.0
"""Largest deviation that is stated."""
_ROUNDS = 20
"""Rounds of reweighting."""
_WINSOR = 9.0
"""Squared errors are cut at this many variances (3 standard deviations), so that wrong contacts do
not widen all deviations."""
_FEWEST = 30
"""Least number of contacts from which a spread is learned."""
_NORMAL_95, _PLANE_95 = 1.959964, 2.447747
"""95 % quantiles of a normal error along one axis, and of its length in the plane (Rayleigh)."""


@dataclass(frozen=True, eq=False)
class ErrorCauses:
    """Causes of the deviations of the K contacts of one frame.

    Attributes:
        noise: (K, 2) deviations of the fit, for x and y together and for depth, mm.
        shift: (K, 2) distances from the equivalents, likewise.
        misfit: (K, 2) chi^2 per degree of freedom.
    """

    noise: Array
    shift: Array
    misfit: Array

    @classmethod
    def of_fit(cls, found: Found, weight: Array, shift: Array, varies: bool) -> ErrorCauses:
        """Return the causes in a fitted frame.

        Args:
            found: The fit.
            weight: (Q,) 1 / variance of the displacements, 1 / px^2.
            shift: (K, 3) shifts from the equivalents to the contacts, mm.
            varies: Whether fields differ from sensor to sensor.
        """
        left = found.solution.left
        chi2 = float((weight * left[0] ** 2).sum())
        misfit = chi2 / max(left.shape[1] - 3 * len(shift), 1)
        return cls.of(found.solution.normal[0], misfit, shift, varies)

    @classmethod
    def of(cls, normal: Array, misfit: float, shift: Array, varies: bool = False) -> ErrorCauses:
        """Return the causes in one frame.

        Args:
            normal: (3 K, 3 K) normal matrix of the fit.
            misfit: chi^2 per degree of freedom.
            shift: (K, 3) shifts from the equivalents to the contacts, mm.
            varies: Whether fields differ from sensor to sensor. Misfit beyond the noise is then
                correlated, and counts as it does in the fit (``hold_of``).
        """
        count = len(shift)
        # Before a fit a contact is known to lie within the dome: nothing is known worse than that.
        information = normal + np.eye(3 * count) / _LARGEST_MM**2
        variance = np.diagonal(np.linalg.inv(information)).reshape(count, 3)
        plane = np.sqrt(variance[:, :2].mean(axis=1))
        if count == 1:  # what a single field leaves unexplained is noise of another size
            noise = max(1.0, misfit)
            plane = plane * np.sqrt(noise * (hold_of(noise, CORRELATED) if varies else 1.0))
        ones = np.ones((count, 2))
        return cls(
            ones * plane[:, None],
            ones * np.linalg.norm(shift, axis=1, keepdims=True),
            ones * misfit,
        )

    @property
    def squares(self) -> Array:
        """Squares (K, 2, 4) of 1 (the floor), noise, shift and misfit."""
        return np.stack([np.ones_like(self.noise), self.noise, self.shift, self.misfit], -1) ** 2


@dataclass(frozen=True, eq=False)
class Spread:
    """The size of each cause.

    Attributes:
        terms: (3, 2, 4) floor, a, b, c of each group, for x and y and for depth.
    """

    terms: Array

    def std(self, clues: ErrorCauses) -> Array:
        """Return the (K, 3) standard deviations of the contacts of one frame, mm."""
        terms = self.terms[min(len(clues.noise), GROUPS) - 1]
        plane, depth = np.sqrt((clues.squares * terms**2).sum(axis=-1)).T
        out: Array = np.stack([plane, plane, depth], axis=1).clip(1e-4, _LARGEST_MM)
        return out

    def with_group(
        self, count: int, clues: list[ErrorCauses], errors: list[Array], floor: bool = True
    ) -> Spread:
        """Return this spread with the group of ``count`` contacts fitted to errors.

        With too few errors the spread stays as it is.

        Args:
            count: Number of contacts; GROUPS stands for more, too.
            clues: Causes of the errors, frame by frame.
            errors: (K, 3) errors of each frame, mm.
            floor: Whether errors have a least size. A floor that was learned on a few sensors does
                not hold for others, whose misfit says more: on eight unseen sensors unlike those of
                the training, 82 % of the truths were in the 95 % intervals of depth with it, and
                93 % without.
        """
        if sum(len(error) for error in errors) < _FEWEST:
            return self
        squares, error = np.concatenate([c.squares for c in clues]), np.concatenate(errors)
        if count == 1:
            squares[..., 2:] = 0.0
        if not floor:
            squares[..., 0] = 0.0
        plane = np.hypot(error[:, 0], error[:, 1])
        terms = self.terms.copy()
        terms[count - 1, 0] = _fit_terms(squares[:, 0], plane**2 / 2, plane, _PLANE_95)
        depth = np.abs(error[:, 2])
        terms[count - 1, 1] = _fit_terms(squares[:, 1], depth**2, depth, _NORMAL_95)
        return Spread(terms)


def _fit_terms(squares: Array, wanted: Array, size: Array, quantile: float) -> Array:
    """Return (4,) terms whose variance follows ``wanted``; 95 % of the sizes are in the quantile.

    It is non-negative least squares weighted by 1 / variance; errors are cut at three deviations.

    Args:
        squares: (N, 4) squares of the causes.
        wanted: (N,) squared errors along one axis, mm^2.
        size: (N,) sizes of the errors, mm.
        quantile: 95 % quantile of the errors, in deviations.
    """
    from scipy.optimize import nnls

    variance = np.full(len(wanted), np.median(wanted) + 1e-12)
    solution = np.zeros(squares.shape[1])
    scale = squares.mean(axis=0) + 1e-300
    for _ in range(_ROUNDS):
        cut = np.minimum(wanted, _WINSOR * variance)
        solution = nnls(squares / scale / variance[:, None], cut / variance)[0] / scale
        variance = np.maximum(squares @ solution, 1e-10)
    ratio = float(np.quantile(size / np.sqrt(variance), 0.95)) / quantile
    terms: Array = np.sqrt(solution) * ratio
    return terms


@cache
def nominal_spread() -> Spread:
    """Return the terms that come with the package.

    They were learned from training pairs and triples of the nominal dome (``Spread.with_group``).
    """
    stored = json.loads(files(__package__).joinpath("spread.json").read_text(encoding="utf-8"))
    return Spread(np.array(stored["terms"]))
