"""A common view of sensors with different pins: displacements on a lattice that all layouts share.

A layout is measured by itself. Its centre is the mean of its pins. Its axes are stretched so that
the pins spread alike along both, which undoes frames that were resized unevenly; its unit is the
mean distance of the six outermost pins from the centre, the corners of a hexagonal layout or some
of the outer ring of a round one. What a TacTip with 127 and one with 331 pins have in common is
this outline, not the pitch or the mean radius of their pins.

Between the pins displacements are interpolated by kriging with a linear trend (Rasmussen and
Williams 2006, eq. 2.41 and 2.42): with K the covariance of the pins, k that of a lattice point with
them, and H = [1, x, y] of the pins,

    weights = h B + k K^-1 (I - H B),    B = (H' K^-1 H)^-1 H' K^-1

so that shifts, turns and stretches of all pins are carried over exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError

Array = npt.NDArray[np.float64]

RINGS, REACH = 6, 0.8
"""Rings of the lattice, which has 127 points, and radius of the last one in units of the layout:
beyond 0.8 a hexagonal layout has pins in its corners only."""
OUTERMOST = 6
"""Pins whose mean radius is the size of a layout: a hexagon has six corners, and one pin may be
lost."""
LENGTH = 0.35
"""Length over which displacements are alike, units of the layout; dimples of a dome are wider."""
NUGGET = 1e-3
"""Variance of a pin's own motion, as a share of that of the field."""


@dataclass(frozen=True, eq=False)
class Outline:
    """The unit by which a layout of pins is measured.

    Attributes:
        centre: (2,) px.
        scale: (2,) px along x and y that are one unit.
    """

    centre: Array
    scale: Array

    @classmethod
    def of(cls, rest: Array) -> Self:
        """Return the outline of pins (P, 2) px at rest.

        Raises:
            UserError: The pins lie on a line, or are fewer than seven.
        """
        centre = rest.mean(axis=0)
        spread = np.sqrt(np.square(rest - centre).mean(axis=0))
        if len(rest) <= OUTERMOST or not spread.min() > 1e-3 * spread.max():
            raise UserError(
                f"{len(rest)} pins lie on a line or are too few to see a sensor's outline by; a "
                "model that moves between sensors needs a rest frame with all pins."
            )
        stretch = spread / np.sqrt(spread.prod())
        radius = np.hypot(*((rest - centre) / stretch).T)
        return cls(centre, stretch * np.sort(radius)[-OUTERMOST:].mean())

    def places(self, xy: Array) -> Array:
        """Return places (..., 2) px relative to the centre, in units of the layout."""
        return np.asarray((xy - self.centre) / self.scale, dtype=np.float64)


def common_lattice() -> Array:
    """Return the (L, 2) points of the lattice, in units of a layout.

    Ring k around the centre has 6 k points, and the last ring lies at ``REACH`` units.
    """
    points = [(0.0, 0.0)]
    for ring in range(1, RINGS + 1):
        turns = 2 * np.pi * np.arange(6 * ring) / (6 * ring)
        radius = REACH * ring / RINGS
        points += list(zip(radius * np.cos(turns), radius * np.sin(turns), strict=True))
    return np.array(points)


def kriging_weights(places: Array, points: Array) -> Array:
    """Return (L, P) weights that give a field at points (L, 2) from its values at places (P, 2)."""
    trend, target = _linear(places), _linear(points)
    inverse = np.linalg.inv(_covariance(places, places) + NUGGET * np.eye(len(places)))
    slope = np.linalg.solve(trend.T @ inverse @ trend, trend.T @ inverse)
    residual = np.eye(len(places)) - trend @ slope
    return np.asarray(target @ slope + _covariance(points, places) @ inverse @ residual)


def common_view(rest: Array, points: Array) -> Callable[[Array], Array]:
    """Return a function from displacements of pins to those on the common lattice.

    It turns displacements (N, 2 P) px, x of all before y of all, into (N, 2 L) in units of the
    layout.

    Args:
        rest: (P, 2) px, the pins at rest.
        points: (L, 2) points of the lattice, in units of the layout.

    Raises:
        UserError: The pins lie on a line, or are fewer than seven.
    """
    outline = Outline.of(rest)
    weights = kriging_weights(outline.places(rest), points)

    def view(moved: Array) -> Array:
        x, y = np.split(moved, 2, axis=1)
        unit_x, unit_y = outline.scale
        return np.concatenate([x @ weights.T / unit_x, y @ weights.T / unit_y], axis=1)

    return view


def _linear(xy: Array) -> Array:
    return np.column_stack([np.ones(len(xy)), xy])


def _covariance(a: Array, b: Array) -> Array:
    square = np.square(a[:, None] - b).sum(axis=-1)
    return np.asarray(np.exp(-0.5 * square / LENGTH**2), dtype=np.float64)
