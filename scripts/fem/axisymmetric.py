"""Axisymmetric finite elements: a dome or a pad under one indenter that slides or sticks.

Coordinates: x is the distance from the axis, y the height, mm. Displacement is P2. Stresses are in
units of the skin's Young's modulus, so forces are in E_skin mm^2. The mesh names its boundaries
"axis", "base" (clamped) and "outer" (where contact may happen).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from elements import Continuation, Dome, Settings, density, mixed_space, require_ngsolve
from spatial import overlap

from tactibench import UserError

Array = npt.NDArray[np.float64]
FRICTION = ("none", "stick")
STEP_MM = 0.05
"""Largest increment of a sticking press; half of it changes pin bases by less than 0.01 mm."""


class AxisymmetricPress:
    """A body and an indenter that comes down on it along the axis."""

    def __init__(
        self,
        mesh: Any,
        moduli: Mapping[str, float],
        top: float,
        radius: float,
        penalty: float,
        settings: Settings | None = None,
        friction: str = "none",
    ) -> None:
        """Set up the equations of the undeformed body.

        Args:
            mesh: Mesh of the body's meridian.
            moduli: Young's modulus of each material of the mesh, in units of the skin's.
            top: Height of the body's apex, where the indenter touches first, mm.
            radius: Radius of the indenter, mm; inf for a plate.
            penalty: Contact stiffness, E_skin / mm.
            settings: Settings of the increments; None: the defaults, with increments of at most
                ``STEP_MM`` where the skin sticks.
            friction: "none", or "stick": the skin does not slip once it touches.

        Raises:
            ValueError: ``friction`` is none of FRICTION.
            UserError: NGSolve is not installed.
        """
        if friction not in FRICTION:
            raise ValueError(f"friction is {friction!r}; allowed: {', '.join(FRICTION)}")
        ngs = require_ngsolve()
        self.mesh, self.top, self.radius, self.penalty = mesh, top, radius, penalty
        moving = ngs.VectorH1(mesh, order=2, dirichlet="base", dirichletx="axis")
        self.space = mixed_space(mesh, moving, moduli)
        self.depth = ngs.Parameter(0.0)
        self.state = ngs.GridFunction(self.space)
        u = self.state.components[0]
        self.tie = Stick(mesh, self.inside(u), u[0], penalty) if friction == "stick" else None
        largest = math.inf if self.tie is None else STEP_MM
        self.path = Continuation(
            self._energy(moduli),
            self.state,
            self.depth.Set,
            displacement=self.space.Range(0),
            settings=settings or Settings(largest=largest),
            on_step=None if self.tie is None else self.tie.update,
        )

    def place(self, u: Any) -> tuple[Any, Any]:
        """Return a point's squared distance from the axis and height above the indenter's end."""
        ngs = require_ngsolve()
        across = ngs.x + u[0]
        return across * across, ngs.y + u[1] - (self.top - self.depth)

    def inside(self, u: Any) -> Any:
        """Return how deep a point of the skin lies inside the indenter, mm (negative: outside)."""
        return overlap(*self.place(u), self.radius)

    def steepness(self, u: Any) -> Any:
        """Return the vertical component of the indenter's normal."""
        return steepness(*self.place(u), self.radius)

    def stored(self, young: float, u: Any, pressure: Any) -> Any:
        """Return the energy per undeformed volume."""
        return density(young, *axisymmetric_strain(u), pressure)

    def _energy(self, moduli: Mapping[str, float]) -> Any:
        ngs = require_ngsolve()
        u, *pressures = self.space.TrialFunction()
        form = ngs.BilinearForm(self.space, symmetric=True)
        for (material, young), pressure in zip(moduli.items(), pressures, strict=True):
            stored = self.stored(young, u, pressure) * ngs.x
            volume = ngs.dx(definedon=self.mesh.Materials(material))
            form += ngs.Variation(stored.Compile() * volume)
        surface = ngs.ds(definedon=self.mesh.Boundaries("outer"))
        push = contact_energy(self.inside(u), self.penalty) * ngs.x
        form += ngs.Variation(push.Compile() * surface)
        if self.tie is not None:
            form += ngs.Variation((self.tie.energy(u[0]) * ngs.x).Compile() * surface)
        return form

    def advance(self, depth: float) -> None:
        """Press to ``depth`` mm past first touch, which is not less than the present depth."""
        self.path.advance(depth)

    def force(self) -> float:
        """Return the total contact force along the axis, E_skin mm^2."""
        ngs = require_ngsolve()
        u = self.state.components[0]
        pressure = contact_pressure(self.inside(u), self.penalty)
        integrand = 2 * math.pi * ngs.x * pressure * self.steepness(u)
        outer = ngs.ds(definedon=self.mesh.Boundaries("outer"))
        return float(ngs.Integrate(integrand * outer, self.mesh))

    def displacement(self, x: Array, y: Array) -> Array:
        """Return (N, 2) radial and axial displacement of N undeformed points of the body, mm."""
        values: Array = np.asarray(self.state.components[0](self.mesh(x, y)))
        return values


class Stick:
    """Sticking contact on boundary "outer": a point that touches keeps its place on the indenter.

    This is the limit of infinite friction. A point's place on the indenter is the one where it
    first touched, interpolated within the increment. From the next increment on, a penalty ties the
    point to that place. So the result depends on the increments: see STEP_MM. For a sphere the tie
    holds up to its equator; beyond it the skin may slide along the rod.

    ``update`` must be called at every equilibrium.
    """

    def __init__(self, mesh: Any, inside: Any, across: Any, penalty: float) -> None:
        """Begin with no point tied.

        Args:
            mesh: Mesh of the body.
            inside: Overlap of the state with the indenter, an NGSolve function, mm.
            across: Radial displacement of the state, an NGSolve function, mm.
            penalty: Stiffness of the tie, E_skin / mm.
        """
        ngs = require_ngsolve()
        self._where = mesh.Boundaries("outer")
        self._now = {"inside": inside, "across": across}
        space = ngs.H1(mesh, order=1, definedon=self._where)
        self._inside, self._across, self._place = (ngs.GridFunction(space) for _ in range(3))
        self._penalty = penalty
        self._inside.Set(inside, definedon=self._where)

    def energy(self, across: Any) -> Any:
        """Return the energy of the tie per area of a trial radial displacement."""
        ngs = require_ngsolve()
        moved = across - self._place
        return self._penalty / 2 * ngs.IfPos(self._inside, moved * moved, 0.0)

    def update(self, _level: float = 0.0) -> None:
        """Tie the points that touched since the last equilibrium, and release those that left."""
        inside, across = self._inside.vec.FV().NumPy(), self._across.vec.FV().NumPy()
        old_inside, old_across = inside.copy(), across.copy()
        self._inside.Set(self._now["inside"], definedon=self._where)
        self._across.Set(self._now["across"], definedon=self._where)
        fresh = (old_inside <= 0) & (inside > 0)
        part = np.ones_like(inside)
        part[fresh] = -old_inside[fresh] / (inside - old_inside)[fresh]
        touched = old_across + part * (across - old_across)
        place = self._place.vec.FV().NumPy()
        place[old_inside <= 0] = touched[old_inside <= 0]


def steepness(square: Any, height: Any, radius: float) -> Any:
    """Return the axial component of the indenter's unit normal: pressure times it is axial force.

    Args:
        square: Squared distance of a point from the axis, mm^2.
        height: Height of the point above the indenter's lowest point, mm.
        radius: Radius of the indenter, mm; inf for a plate.
    """
    if math.isinf(radius):
        return 1.0
    above = height - radius
    ngs = require_ngsolve()
    return ngs.IfPos(above, 0.0, -above / (radius - overlap(square, height, radius)))


def contact_energy(inside: Any, penalty: float) -> Any:
    """Return the energy of frictionless contact per area: half the penalty times overlap^2."""
    ngs = require_ngsolve()
    return penalty / 2 * ngs.IfPos(inside, inside * inside, 0.0)


def contact_pressure(inside: Any, penalty: float) -> Any:
    """Return the pressure of frictionless contact."""
    ngs = require_ngsolve()
    return ngs.IfPos(inside, penalty * inside, 0.0)


def axisymmetric_strain(u: Any) -> tuple[Any, Any]:
    """Return (tr F^T F, det F) of the deformation gradient F of a displacement (radial, axial)."""
    ngs = require_ngsolve()
    plane = ngs.Id(2) + ngs.Grad(u)
    hoop = 1 + u[0] / ngs.x
    return ngs.InnerProduct(plane, plane) + hoop * hoop, ngs.Det(plane) * hoop


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
