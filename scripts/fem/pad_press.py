"""A flat pad pressed by a sphere: the planar sensor, and the block of Sneddon's solution."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from axisymmetric import Array, AxisymmetricPress

from tactibench import UserError
from tactibench_sim.fem.body import require_ngsolve
from tactibench_sim.fem.continuation import Settings


@dataclass(frozen=True)
class Pad:
    """A flat round pad of gel with a skin, bonded to a rigid backing; its side is free.

    Lengths are in mm, moduli in units of the skin's.

    Attributes:
        thickness: Thickness of gel and skin together.
        skin: Thickness of the skin; 0 for none. The gel's modulus is 1 / stiffness_ratio all the
            same.
        stiffness_ratio: E_skin / E_gel.
        width: Diameter of the pad.
        marker_depth: Depth of the markers below the surface.
        contact_size: Largest element edge of the surface within ``contact_radius`` of the axis.
        contact_radius: Radius of the part of the surface that has fine elements.
        skin_size: Largest element edge elsewhere in the skin.
        gel_size: Largest element edge in the gel.
        penalty: Contact stiffness, E_skin / mm.

    Raises:
        ValueError: The skin is as thick as the pad, or the markers or the fine elements lie outside
            of the pad.
    """

    thickness: float = 10.0
    skin: float = 0.5
    stiffness_ratio: float = 10.0
    width: float = 60.0
    marker_depth: float = 1.0
    contact_size: float = 0.1
    contact_radius: float = 4.0
    skin_size: float = 0.5
    gel_size: float = 1.5
    penalty: float = 100.0

    def __post_init__(self) -> None:
        if not 0 <= self.skin < self.thickness:
            raise ValueError(f"skin is {self.skin} mm; it must be from 0 to below the thickness")
        if not 0 <= self.marker_depth < self.thickness:
            raise ValueError(f"marker_depth is {self.marker_depth} mm; it must be inside the pad")
        if not 0 < self.contact_radius < self.width / 2:
            raise ValueError(f"contact_radius is {self.contact_radius} mm; it must be on the pad")

    @property
    def moduli(self) -> dict[str, float]:
        """Young's modulus of each material."""
        gel = {"gel": 1.0 / self.stiffness_ratio}
        return {"skin": 1.0, **gel} if self.skin else gel


@dataclass(frozen=True, eq=False)
class PadProfile:
    """One converged state at N undeformed distances from the axis.

    Attributes:
        delta: Penetration, mm.
        force: Force along the axis, E_skin mm^2.
        surface: (2, N) displacement w into the pad and t away from the axis of the surface, mm.
        marker: (2, N) the same of points ``marker_depth`` below the surface, mm.
    """

    delta: float
    force: float
    surface: Array
    marker: Array


def press_pad(
    pad: Pad, radius: float, deltas: Array, r: Array, *, settings: Settings | None = None
) -> Iterator[PadProfile]:
    """Yield the state of the pad at each depth of a press on its axis.

    For depths beyond its radius the sphere is the end of a rod.

    Args:
        pad: Pad that is pressed.
        radius: Radius of the sphere, mm.
        deltas: (D,) penetrations, ascending, mm.
        r: (N,) distances from the axis, mm, 0..width / 2.
        settings: Settings of the increments; None: those of ``AxisymmetricPress``.

    Raises:
        UserError: The indenter is a plate, which all of a flat pad would touch at once, or NGSolve
            is not installed.
        NotConvergedError: A run failed.
    """
    if math.isinf(radius):
        raise UserError("a flat pad is pressed by spheres only; give a finite radius.")
    problem = AxisymmetricPress(
        pad_meridian(pad), pad.moduli, pad.thickness, radius, pad.penalty, settings
    )
    for delta in deltas:
        problem.advance(float(delta))
        surface = _level(problem, pad, r, 0.0)
        marker = _level(problem, pad, r, pad.marker_depth)
        yield PadProfile(float(delta), problem.force(), surface, marker)


def _level(problem: AxisymmetricPress, pad: Pad, r: Array, below: float) -> Array:
    """Return the (2, N) displacement into the pad and away from the axis, mm, in one level.

    Args:
        problem: State of the pad.
        pad: Pad that is pressed.
        r: (N,) distances from the axis, mm.
        below: Depth of the level below the surface, mm.
    """
    inside = 1e-7 * pad.width
    x = np.clip(r, inside, pad.width / 2 - inside)
    y = np.full_like(x, min(pad.thickness - below, pad.thickness - inside))
    u = problem.displacement(x, y)
    along = np.where(r == 0, 0.0, u[:, 0])
    return np.stack([-u[:, 1], along])


def pad_meridian(pad: Pad) -> Any:
    """Return the mesh of a meridian: rectangles of gel and skin, fine at the contact.

    The backing is at height 0.
    """
    ngs = require_ngsolve()
    from netgen.occ import Glue, OCCGeometry, WorkPlane

    inner, side, top = pad.contact_radius, pad.width / 2, pad.thickness
    layers = [("gel", 0.0, top - pad.skin, pad.gel_size)]
    if pad.skin:
        layers.append(("skin", top - pad.skin, top, pad.skin_size))
    parts = []
    for name, low, high, size in layers:
        for left, right in ((0.0, inner), (inner, side)):
            part = WorkPlane().MoveTo(left, low).Rectangle(right - left, high - low).Face()
            part.faces.name, part.faces.maxh = name, size
            parts.append(part)
    shape = Glue(parts)
    for edge in shape.edges:
        (x0, y0, _), (x1, y1, _) = edge.start, edge.end
        if max(abs(x0), abs(x1)) < 1e-9:
            edge.name = "axis"
        elif max(abs(y0), abs(y1)) < 1e-9:
            edge.name = "base"
        elif min(y0, y1) > top - 1e-9:
            edge.name = "outer"
            edge.maxh = pad.contact_size if max(x0, x1) < inner + 1e-9 else layers[-1][3]
        else:
            edge.name = "interface" if abs(y0 - y1) < 1e-9 else "side"
    return ngs.Mesh(OCCGeometry(shape, dim=2).GenerateMesh(maxh=pad.gel_size, grading=0.15))
