"""An axisymmetric body under one indenter on its axis.

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

from tactibench_sim.fem.continuation import Continuation, Settings
from tactibench_sim.fem.extra import require_ngsolve
from tactibench_sim.fem.friction import STEP_MM, Stick
from tactibench_sim.fem.indenters import contact_energy, contact_pressure, overlap, steepness
from tactibench_sim.fem.materials import axisymmetric_strain, density, mixed_space

Array = npt.NDArray[np.float64]
FRICTION = ("none", "stick")


class AxisymmetricPress:
    """The body of ``mesh`` and an indenter that comes down from height ``top``.

    moduli: Young's modulus of each material of the mesh. radius: mm, inf for a plate. penalty:
    contact stiffness, E_skin / mm. friction: "none" or "stick" (no slip once touching, whose
    increments are ``friction.STEP_MM`` at most unless ``settings`` are given).
    """

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
        """Squared distance from the axis and height above the indenter's lowest point."""
        ngs = require_ngsolve()
        across = ngs.x + u[0]
        return across * across, ngs.y + u[1] - (self.top - self.depth)

    def inside(self, u: Any) -> Any:
        """How deep a point of the surface lies inside the indenter, mm (negative: outside)."""
        return overlap(*self.place(u), self.radius)

    def steepness(self, u: Any) -> Any:
        """Vertical component of the indenter's normal."""
        return steepness(*self.place(u), self.radius)

    def stored(self, young: float, u: Any, pressure: Any) -> Any:
        """Energy per undeformed volume."""
        return density(young, *axisymmetric_strain(u), pressure)

    def _energy(self, moduli: Mapping[str, float]) -> Any:
        ngs = require_ngsolve()
        u, *pressures = self.space.TrialFunction()
        form = ngs.BilinearForm(self.space, symmetric=True)
        for (material, young), pressure in zip(moduli.items(), pressures, strict=True):
            stored = self.stored(young, u, pressure) * ngs.x
            here = ngs.dx(definedon=self.mesh.Materials(material))
            form += ngs.Variation(stored.Compile() * here)
        surface = ngs.ds(definedon=self.mesh.Boundaries("outer"))
        push = contact_energy(self.inside(u), self.penalty) * ngs.x
        form += ngs.Variation(push.Compile() * surface)
        if self.tie is not None:
            form += ngs.Variation((self.tie.energy(u[0]) * ngs.x).Compile() * surface)
        return form

    def advance(self, depth: float) -> None:
        """Go down to ``depth`` mm past first touch, at least the present depth."""
        self.path.advance(depth)

    def force(self) -> float:
        """Total contact force along the axis, E_skin mm^2."""
        ngs = require_ngsolve()
        u = self.state.components[0]
        pressure = contact_pressure(self.inside(u), self.penalty)
        integrand = 2 * math.pi * ngs.x * pressure * self.steepness(u)
        outer = ngs.ds(definedon=self.mesh.Boundaries("outer"))
        return float(ngs.Integrate(integrand * outer, self.mesh))

    def displacement(self, x: Array, y: Array) -> Array:
        """(N, 2) radial and axial displacement of N undeformed points of the body, mm."""
        values: Array = np.asarray(self.state.components[0](self.mesh(x, y)))
        return values
