"""The dome under any number of indenters, in three dimensions: the reference for everything else.

P2 displacement and one P1 pressure of each material, frictionless contact. With the default mesh,
the pin bases under a sphere of 3 mm on the apex differ from the axisymmetric runs by at most
0.012 mm down to 4 mm depth and 0.016 mm at 6 mm, the force by 1.5 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim.fem.body import Dome, density, mixed_space, require_ngsolve, spatial_strain
from tactibench_sim.fem.continuation import Continuation, Settings
from tactibench_sim.fem.field import SpatialField
from tactibench_sim.fem.mesh import Spot, dome_volume
from tactibench_sim.fem.tip import Tip, rounded_energy

Array = npt.NDArray[np.float64]
SPATIAL = Settings(
    first=0.15,
    largest=1.0,
    smallest=5e-3,
    steps=16,
    tolerance=1e-3,  # moves shrink quadratically: the next would be about a thousandth of it
    inverse="sparsecholesky",  # half to a third of umfpack's time
    predictor="tangent",
    diverging=1.5,
)
_COMPRESSIBILITY = 1e-6  # of the factorised tangent only, which else has no Cholesky factors


@dataclass(frozen=True)
class Fineness:
    """Element edges of a mesh.

    Attributes:
        contact: Edge under a spherical tip, in units of its radius.
        largest: Largest edge under a spherical tip, and the edge under a plate, mm.
        margin: Distance beyond a tip's radius to which the elements are small, mm; half of it
            beyond where a plate touches.
        far: Largest edge elsewhere, mm.
    """

    contact: float = 0.4
    largest: float = 1.9
    margin: float = 2.0
    far: float = 4.5

    def spot(self, dome: Dome, tip: Tip, depths: Array) -> Spot:
        """Return the part of the skin that a tip will touch at ``depths`` (N,), mm."""
        ends = [tip.centre(depth) for depth in (max(depths.min(), 0.0), max(depths.max(), 0.0))]
        if math.isinf(tip.radius):
            height = min(max(float(np.array(tip.axis) @ ends[1]), 0.0), dome.outer)
            touched = math.sqrt(dome.outer**2 - height**2)
            return Spot(np.array(tip.axis), touched + self.margin / 2, self.largest)
        first, last = (end / np.linalg.norm(end) for end in ends)
        middle = (first + last) / np.linalg.norm(first + last)
        drift = dome.outer * math.acos(min(float(first @ middle), 1.0))
        edge = min(self.contact * tip.radius, self.largest)
        return Spot(middle, min(tip.radius, 8.0) + self.margin + drift, edge)


class SpatialPress:
    """A dome and its tips: ``move`` moves them, ``field`` returns the present equilibrium.

    Args:
        dome: The dome.
        tips: K tips.
        depths: (N, K) depths for which the mesh is made, mm. The run starts from the first row, or
            from 0 where that is deeper.
        mirror: Mesh the half y > 0 only. Every tip beside the plane y = 0 then stands for itself
            and its image.
        fineness: Element edges; None: the defaults.
        settings: Settings of the increments and the Newton method.

    Raises:
        UserError: NGSolve is not installed.
        ValueError: The depths have another shape or are not finite, or a tip does not fit the
            mirror plane.
    """

    def __init__(
        self,
        dome: Dome,
        tips: Sequence[Tip],
        depths: Array,
        *,
        mirror: bool = False,
        fineness: Fineness | None = None,
        settings: Settings = SPATIAL,
    ) -> None:
        ngs = require_ngsolve()
        planned = np.asarray(depths, dtype=np.float64)
        _check(tips, planned, mirror)
        self.dome, self.tips, self.mirror = dome, tuple(tips), mirror
        fineness = fineness or Fineness()
        spots = [fineness.spot(dome, tip, planned[:, k]) for k, tip in enumerate(self.tips)]
        self.mesh = dome_volume(dome, spots, fineness.far, mirror)
        held = {"dirichlet": "base", **({"dirichlety": "mirror"} if mirror else {})}
        moving = ngs.VectorH1(self.mesh, order=2, **held)
        self.space = mixed_space(self.mesh, moving, dome.moduli)
        self.state = ngs.GridFunction(self.space)
        self.depths = np.minimum(planned[0], 0.0)
        self._way = np.zeros_like(self.depths)
        self._from, self._since = self.depths, 0.0
        self._at = [ngs.Parameter(float(depth)) for depth in self.depths]
        self._contacts = [self._contact(k) for k in range(len(self.tips))]
        form, tangent = self.forms(lambda u: [self._push(k, u) for k in range(len(self.tips))])
        self.path = Continuation(
            form,
            self.state,
            self._set,
            displacement=self.space.Range(0),
            settings=settings,
            tangent=tangent,
        )

    def _set(self, level: float) -> None:
        """Set the depths at a level: the way so far of the tip with the longest way, mm."""
        self.depths = self._from + (level - self._since) * self._way
        for parameter, depth in zip(self._at, self.depths, strict=True):
            parameter.Set(float(depth))

    def forms(self, contacts: Callable[[Any], Sequence[Any]]) -> tuple[Any, Any]:
        """Return the energy, and the energy whose second derivative is factorised.

        Args:
            contacts: Function that returns the terms of what touches the skin, for a trial
                displacement.
        """
        ngs = require_ngsolve()
        forms = [ngs.BilinearForm(self.space, symmetric=True) for _ in range(2)]
        u, *pressures = self.space.TrialFunction()
        for (material, young), pressure in zip(self.dome.moduli.items(), pressures, strict=True):
            stored = density(young, *spatial_strain(u), pressure)
            soft = stored - _COMPRESSIBILITY / (2 * young) * pressure * pressure
            volume = ngs.dx(definedon=self.mesh.Materials(material))
            for form, energy in zip(forms, (stored, soft), strict=True):
                form += ngs.Variation(energy.Compile() * volume)
        for form in forms:
            for term in contacts(u):
                form += term
        return forms[0], forms[1]

    def _push(self, k: int, u: Any) -> Any:
        ngs = require_ngsolve()
        place = [ngs.x + u[0], ngs.y + u[1], ngs.z + u[2]]
        tip = self.tips[k]
        energy = rounded_energy(tip.inside(place, self._at[k]), tip.cushion)
        return ngs.Variation(energy.Compile() * ngs.ds(definedon=self.mesh.Boundaries("outer")))

    def _contact(self, k: int) -> Any:
        """Return the energy of one tip's contact; its first derivative is the force on the skin."""
        form = require_ngsolve().BilinearForm(self.space, symmetric=True)
        form += self._push(k, self.space.TrialFunction()[0])
        return form

    def move(self, depths: Array) -> None:
        """Move the tips to (K,) depths, mm, on a straight way.

        Raises:
            ValueError: The depths have another shape or are not finite.
            NotConvergedError: A run failed; the state is the last equilibrium on the way.
        """
        goal = np.asarray(depths, dtype=np.float64)
        _check(self.tips, goal[None], self.mirror)
        length = float(np.abs(goal - self.depths).max())
        if length < 1e-12:
            return
        self._from, self._since = self.depths, self.path.level
        self._way = (goal - self.depths) / length
        self.path.advance(self._since + length)

    def field(self) -> SpatialField:
        """Return the present equilibrium."""
        forces = np.array([self._force(k) for k in range(len(self.tips))])
        return SpatialField(
            self.dome, self.mesh, self.state, self.mirror, self.depths.copy(), forces
        )

    def _force(self, k: int) -> Array:
        """Return the (3,) force of a tip in the discrete equilibrium, at its integration points."""
        ngs = require_ngsolve()
        resisting, shift = self.state.vec.CreateVector(), ngs.GridFunction(self.space)
        self._contacts[k].Apply(self.state.vec, resisting)
        force = np.zeros(3)
        for axis, unit in enumerate(np.eye(3)):
            shift.components[0].Set(tuple(map(float, unit)))
            force[axis] = -ngs.InnerProduct(resisting, shift.vec)
        if self.mirror and self.tips[k].start[1] == 0:
            force *= [2.0, 0.0, 2.0]
        return force


def _check(tips: Sequence[Tip], depths: Array, mirror: bool) -> None:
    if depths.ndim != 2 or depths.shape[1] != len(tips) or not len(tips) or not len(depths):
        raise ValueError(f"depths have the shape {depths.shape}; it must be (N, {len(tips)})")
    if not np.isfinite(depths).all():
        raise ValueError("a depth is not finite")
    for tip in tips:
        if mirror and (tip.start[1] < 0 or (tip.start[1] == 0 and tip.axis[1] != 0)):
            raise ValueError(f"{tip} does not fit the mirror plane; it must be at y >= 0")
