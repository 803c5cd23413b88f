"""Rigid indenters in three dimensions: spheres that end a rod, and plates, moved along an axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim.fem.body import Dome, require_ngsolve

Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Cushion:
    """The stiffness of a contact.

    Attributes:
        penalty: Stiffness, E_skin / mm.
        rounding: Overlap over which the stiffness is reached, mm.
    """

    penalty: float
    rounding: float


SPHERE = Cushion(60.0, 0.01)
PLATE = Cushion(20.0, 0.04)
"""Softer, because a plate touches much of the skin at once, at a small pressure."""


@dataclass(frozen=True)
class Tip:
    """An indenter that moves from ``start`` along -axis as its depth grows from 0.

    At depth 0 it must not overlap the dome.

    Attributes:
        start: The sphere's centre, or a point of the plate, at depth 0, mm from the dome's centre.
        axis: Unit vector along its rod, or the plate's normal, out of the dome.
        radius: Radius of the sphere, mm; inf for a plate.

    Raises:
        ValueError: A number is not finite, the radius is not positive, or the axis is no unit
            vector.
    """

    start: Vector
    axis: Vector
    radius: float

    def __post_init__(self) -> None:
        if not np.isfinite([self.start, self.axis]).all() or not self.radius > 0:
            raise ValueError(f"a tip must be finite, its radius positive; this one is {self}")
        if abs(math.hypot(*self.axis) - 1) > 1e-9:
            raise ValueError(f"a tip's axis must be a unit vector; this one is {self.axis}")

    @classmethod
    def along_axis(cls, dome: Dome, direction: Array, radius: float) -> Tip:
        """Return a tip that presses towards the dome's centre; its depth is the penetration.

        Args:
            dome: The dome.
            direction: (3,) unit vector from the dome's centre to the tip.
            radius: Radius of the sphere, mm; inf for a plate.
        """
        reach = dome.outer + (0.0 if math.isinf(radius) else radius)
        n = np.asarray(direction, dtype=np.float64)
        return cls(_vector(reach * n), _vector(n), radius)

    @classmethod
    def downwards(cls, dome: Dome, x: float, y: float, radius: float) -> Tip:
        """Return a sphere that presses along -z beside the dome's axis; at depth 0 it touches.

        Args:
            dome: The dome.
            x: Place of the sphere's axis, mm.
            y: Place of the sphere's axis, mm.
            radius: Radius of the sphere, mm.

        Raises:
            ValueError: The sphere would pass beside the dome.
        """
        square = (dome.outer + radius) ** 2 - x * x - y * y
        if not 0 < square < math.inf:
            raise ValueError(f"no sphere of {radius} mm comes down on the dome at ({x}, {y}) mm")
        return cls((float(x), float(y), math.sqrt(square)), (0.0, 0.0, 1.0), radius)

    @property
    def cushion(self) -> Cushion:
        """Stiffness of the contact."""
        return PLATE if math.isinf(self.radius) else SPHERE

    def centre(self, depth: float) -> Array:
        """Return the sphere's centre, or a point of the plate, at a depth, mm."""
        return np.array(self.start) - depth * np.array(self.axis)

    def inside(self, place: Any, depth: Any) -> Any:
        """Return how deep a deformed place (an NGSolve vector) lies inside the tip, mm."""
        q, along = self._split(place, depth)
        if math.isinf(self.radius):
            return along
        side = [q[i] * self.axis[j] - q[j] * self.axis[i] for i, j in ((1, 2), (2, 0), (0, 1))]
        square = sum(component * component for component in side)  # never below 0
        return overlap(square, along + self.radius, self.radius)

    def _split(self, place: Any, depth: Any) -> tuple[list[Any], Any]:
        """Return the place from the tip's centre, and its component along the axis."""
        q = [place[i] - self.start[i] + depth * self.axis[i] for i in range(3)]
        return q, sum(q[i] * self.axis[i] for i in range(3))


def overlap(square: Any, height: Any, radius: float) -> Any:
    """Return how deep a point lies inside an indenter, mm (negative: outside).

    Args:
        square: Squared distance from the indenter's axis.
        height: Height above the indenter's lowest point, against the pressing direction, mm.
        radius: Radius of the sphere that ends a rod, mm; inf for a plate, which fills the
            half-space.
    """
    if math.isinf(radius):
        return height
    ngs = require_ngsolve()
    above = height - radius
    below = ngs.IfPos(above, 0.0, above)
    return radius - ngs.sqrt(square + below * below + 1e-20)  # no division by zero on the axis


def rounded_energy(inside: Any, cushion: Cushion) -> Any:
    """Return the energy of frictionless contact per area, twice continuously differentiable.

    The stiffness of the penalty rises linearly from 0. So Newton meets no kink when points begin to
    touch, which allows increments of a millimetre.

    Args:
        inside: Overlap, mm; negative: none.
        cushion: Stiffness of the contact.
    """
    ngs = require_ngsolve()
    e = cushion.rounding
    beyond = inside * inside / 2 - e * inside / 2 + e * e / 6
    within = inside * inside * inside / (6 * e)
    return cushion.penalty * ngs.IfPos(inside - e, beyond, ngs.IfPos(inside, within, 0.0))


def _vector(values: Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
