"""The dome in three dimensions: half-balls of gel and skin, glued, fine where something touches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim.fem.body import Dome, require_ngsolve

Array = npt.NDArray[np.float64]
GRADING = 0.3
"""Netgen's growth of element edges away from a refined spot; 0.3 is its default."""
_SPACING = 0.7  # of the points that request small elements, in element edges


@dataclass(frozen=True)
class Spot:
    """A round part of the skin with small elements on both of its surfaces.

    Attributes:
        direction: (3,) unit vector from the dome's centre to the middle of the part.
        reach: Radius of the part along the outer surface, mm.
        edge: Edge of the elements, mm.
    """

    direction: Array
    reach: float
    edge: float

    def points(self, radius: float) -> Array:
        """Return (N, 3) points of the outer surface, on a square grid of the azimuthal chart."""
        step = _SPACING * self.edge
        count = math.floor(self.reach / step)
        i, j = np.meshgrid(*[step * np.arange(-count, count + 1)] * 2)
        r = np.hypot(i, j).ravel()
        first, second = across(self.direction)
        side = np.outer(i, first).reshape(-1, 3) + np.outer(j, second).reshape(-1, 3)
        points = np.cos(r / radius)[:, None] * radius * self.direction
        points = points + np.sinc(r / radius / np.pi)[:, None] * side
        return np.asarray(points[r <= self.reach], dtype=np.float64)


def across(direction: Array) -> tuple[Array, Array]:
    """Return two unit vectors that complete a direction to an orthonormal basis."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(helper, direction)
    first = first / np.linalg.norm(first)
    return first, np.cross(direction, first)


def dome_volume(dome: Dome, spots: Sequence[Spot], far: float, mirror: bool) -> Any:
    """Mesh the dome with curved tetrahedra of materials "skin" and "gel".

    Its boundaries are "base" (z = 0), "outer", and "mirror" (y = 0) where only the half y > 0 is
    meshed.

    Args:
        dome: The dome.
        spots: Parts of the skin with small elements.
        far: Largest element edge, mm.
        mirror: Whether only the half y > 0 is meshed.
    """
    ngs = require_ngsolve()
    from netgen.meshing import MeshingParameters
    from netgen.occ import Box, Glue, OCCGeometry, Sphere

    size = 2 * dome.outer
    above = Box((-size, 0 if mirror else -size, 0), (size, size, size))
    gel = Sphere((0, 0, 0), dome.inner) * above
    skin = (Sphere((0, 0, 0), dome.outer) - Sphere((0, 0, 0), dome.inner)) * above
    gel.solids.name, skin.solids.name = "gel", "skin"
    shape = Glue([skin, gel])
    for face in shape.faces:
        face.name = _name(face, dome, mirror)
    parameters = MeshingParameters(maxh=far, grading=GRADING)
    for spot in spots:
        for point in spot.points(dome.outer):
            if point[2] < 0.02 * dome.outer or (mirror and point[1] < -1e-9 * dome.outer):
                continue
            for at in (point, point * (dome.inner / dome.outer)):
                parameters.RestrictH(*map(float, at), h=float(spot.edge))
    mesh = ngs.Mesh(OCCGeometry(shape).GenerateMesh(mp=parameters))
    mesh.Curve(2)
    return mesh


def _name(face: Any, dome: Dome, mirror: bool) -> str:
    centre = face.center
    if abs(centre.z) < 1e-6:
        return "base"
    if mirror and abs(centre.y) < 1e-6:
        return "mirror"
    corner = math.hypot(*next(iter(face.vertices)).p)
    return "outer" if corner > (dome.outer + dome.inner) / 2 else "interface"
