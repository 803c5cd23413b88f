"""Axisymmetric finite elements: a body under one indenter on its axis, sliding or sticking.

Coordinates: x is the distance from the axis, y the height, mm. Displacement is P2. Stresses are in
units of the skin's Young's modulus, so forces are in E_skin mm^2. The mesh names its boundaries
"axis", "base" (clamped) and "outer" (where contact may happen).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim.fem.body import density, mixed_space, require_ngsolve
from tactibench_sim.fem.continuation import Continuation, Settings
from tactibench_sim.fem.tip import overlap

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
