"""The dome pressed on its apex, by axisymmetric finite elements."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from axisymmetric import Array, AxisymmetricPress

from tactibench_sim.fem.body import Dome, require_ngsolve
from tactibench_sim.fem.continuation import Settings


@dataclass(frozen=True, eq=False)
class Profile:
    """One converged state, sampled at T polar angles on the inner and the outer skin.

    Attributes:
        delta: Penetration, mm.
        force: Total force along the axis, E_skin mm^2.
        inner: (2, T) inward normal and tangential (away from the contact) displacement of the inner
            skin, mm.
        outer: (2, T) the same of the outer skin, mm.
    """

    delta: float
    force: float
    inner: Array
    outer: Array


def press(
    dome: Dome,
    radius: float,
    deltas: Array,
    polar: Array,
    *,
    friction: str = "none",
    settings: Settings | None = None,
) -> Iterator[Profile]:
    """Yield the state of the dome at each depth of a press on its apex.

    For depths beyond its radius the sphere is the end of a vertical rod.

    Args:
        dome: Dome that is pressed.
        radius: Radius of the sphere, mm; inf: a plate.
        deltas: (D,) penetrations, ascending, mm.
        polar: (T,) sampling angles, rad, 0..pi/2.
        friction: "none", or "stick": the skin does not slip once it touches, which is exact in the
            limit of small increments (``axisymmetric.STEP_MM``).
        settings: Settings of the increments; None: those of ``AxisymmetricPress``.

    Raises:
        NotConvergedError: A run failed.
        UserError: NGSolve is not installed.
    """
    mesh = dome_meridian(dome)
    problem = AxisymmetricPress(
        mesh, dome.moduli, dome.outer, radius, dome.penalty, settings, friction
    )
    for delta in deltas:
        problem.advance(float(delta))
        inner = _meridian(problem, dome.inner, polar)
        outer = _meridian(problem, dome.outer - 1e-5, polar)
        yield Profile(float(delta), problem.force(), inner, outer)


def _meridian(problem: AxisymmetricPress, radius: float, polar: Array) -> Array:
    """Return the (2, T) inward and tangential displacement at an undeformed radius, mm."""
    angle = np.clip(polar, 1e-7, math.pi / 2 - 1e-7)
    sine, cosine = np.sin(angle), np.cos(angle)
    u = problem.displacement(radius * sine, radius * cosine)
    inward = -(u[:, 0] * sine + u[:, 1] * cosine)
    along = u[:, 0] * cosine - u[:, 1] * sine
    along[polar == 0] = 0.0
    return np.stack([inward, along])


def dome_meridian(dome: Dome) -> Any:
    """Return the mesh of a meridian: quarter discs of gel and skin, curved elements, fine apex."""
    ngs = require_ngsolve()
    from netgen.occ import Glue, OCCGeometry, Rectangle, WorkPlane

    quarter = Rectangle(2 * dome.outer, 2 * dome.outer).Face()
    full = WorkPlane().Circle(dome.outer).Face() * quarter
    gel = WorkPlane().Circle(dome.inner).Face() * quarter
    skin = full - gel
    gel.faces.name, gel.faces.maxh = "gel", dome.gel_size
    skin.faces.name, skin.faces.maxh = "skin", dome.skin_size
    shape = Glue([skin, gel])
    for edge in shape.edges:
        (x0, y0, _), (x1, y1, _) = edge.start, edge.end
        if max(abs(x0), abs(x1)) < 1e-9:
            edge.name = "axis"
        elif max(abs(y0), abs(y1)) < 1e-9:
            edge.name = "base"
        else:
            edge.name = "outer" if math.hypot(x0, y0) > dome.inner + 1e-9 else "interface"
            edge.maxh = dome.skin_size
    for vertex in shape.vertices:
        x, y, _ = vertex.p
        if abs(x) < 1e-9 and y > dome.inner - 1e-9:
            vertex.maxh = dome.apex_size
    netgen = OCCGeometry(shape, dim=2).GenerateMesh(maxh=dome.gel_size, grading=0.15)
    mesh = ngs.Mesh(netgen)
    mesh.Curve(3)
    return mesh
