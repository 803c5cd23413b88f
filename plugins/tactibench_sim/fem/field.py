"""The converged state of a dome under indenters."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim.fem.body import Dome, require_ngsolve
from tactibench_sim.fem.mesh import across

Array = npt.NDArray[np.float64]
_INSIDE = 1e-4  # mm that a place is moved into the body, so that its element is found
_SHRINKS = (0.0, 1e-4, 4e-4, 2e-3)  # curved elements of 9 mm edge lie up to 0.02 mm inside
_STENCIL = ((0.018, 58 / 252), (0.036, 67 / 252), (0.054, -22 / 252))
"""(rad, weight) of the slope of a cubic fitted to seven places within +-1 mm, about an element,
across whose border the displacement has a kink. Compared with differences over 0.012 rad to both
sides this halves the error of a pin's tip, to 0.006 mm rms for 2 mm pins on the default mesh."""


class SpatialField:
    """An equilibrium: the displacement of the dome's points.

    Args:
        dome: The dome.
        mesh: NGSolve mesh of the dome.
        state: GridFunction (displacement, pressures), which is copied.
        mirror: Whether only the half y > 0 is meshed.
        depths: (K,) depths of the tips, mm.
        forces: (K, 3) forces on the skin by each tip, E_skin mm^2. Where the mirror plane cuts the
            contact of a tip, the force is that of the whole contact.
    """

    def __init__(
        self, dome: Dome, mesh: Any, state: Any, mirror: bool, depths: Array, forces: Array
    ) -> None:
        self.dome, self.mirror = dome, mirror
        self.depths, self.forces = depths, forces
        self._mesh = mesh
        self._state = require_ngsolve().GridFunction(state.space)
        self._state.vec.data = state.vec

    def inner(self, directions: Array) -> Array:
        """Return (P, 3) displacement of the inner skin, mm, at (P, 3) unit vectors with z >= 0."""
        return self._displacement(self.dome.inner - _INSIDE, directions)

    def outer(self, directions: Array) -> Array:
        """Return (P, 3) displacement of the outer skin, mm, at (P, 3) unit vectors with z >= 0."""
        return self._displacement(self.dome.outer - _INSIDE, directions)

    def inner_normals(self, directions: Array) -> Array:
        """Return the (P, 3) outward unit normals of the displaced inner skin."""
        radius, b = self.dome.inner - _INSIDE, np.asarray(directions, dtype=np.float64)
        basis = np.array([across(direction) for direction in b]).reshape(-1, 2, 3)
        slopes = np.zeros((2, len(b), 3))
        for k in range(2):
            for angle, weight in _STENCIL:
                for side in (-1, 1):
                    to = math.cos(angle) * b + side * math.sin(angle) * basis[:, k]
                    slopes[k] += side * weight * (radius * to + self._continued(radius, to))
        normal = np.cross(*slopes)
        out: Array = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        return out

    def _displacement(self, radius: float, directions: Array) -> Array:
        b = np.asarray(directions, dtype=np.float64)
        if b.ndim != 2 or b.shape[1] != 3:
            raise ValueError(f"directions have the shape {b.shape}; it must be (P, 3)")
        if not (np.abs((b * b).sum(axis=1) - 1) < 1e-6).all():
            raise ValueError("directions must be unit vectors")
        if (b[:, 2] < -1e-9).any():
            raise ValueError("a direction points below the dome's base; its z must be 0 or more")
        if not len(b):
            return np.zeros((0, 3))
        image = self.mirror & (b[:, 1] < 0)
        x, y, z = radius * b.T
        if self.mirror:
            y = np.maximum(np.abs(y), _INSIDE)
        u = self._inside(np.stack([x, y, np.maximum(z, _INSIDE)], axis=1))
        u[image, 1] *= -1
        if self.mirror:  # exactly odd: points of the plane were evaluated a little beside it
            u[:, 1] *= np.minimum(np.abs(b[:, 1]) * radius / _INSIDE, 1.0)
        return u

    def _inside(self, points: Array) -> Array:
        """Return the displacement at (P, 3) places, moved inwards until they are in an element."""
        out, rest = np.empty_like(points), np.arange(len(points))
        for shrink in _SHRINKS:
            elements = self._mesh(*(points[rest] * (1 - shrink)).T)
            inside = elements["nr"] >= 0
            if inside.any():
                out[rest[inside]] = self._state.components[0](elements[inside])
            rest = rest[~inside]
            if not len(rest):
                return out
        raise RuntimeError("a point of the skin lies in no element of the mesh")

    def _continued(self, radius: float, directions: Array) -> Array:
        """Return the displacement, continued smoothly below the base, where it vanishes."""
        above = directions * np.where(directions[:, 2:] < 0, [1.0, 1.0, -1.0], 1.0)
        return np.where(directions[:, 2:] < 0, -1, 1) * self._displacement(radius, above)
