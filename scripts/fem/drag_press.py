"""A pressed dome whose tips move sideways and drag the skin: stick, or Coulomb's friction.

The tips are pressed without friction and then moved together, parallel to the dome's base. Each
touching point follows its tip by a spring along the tip's surface, whose force Coulomb's friction
limits to mu times the pressure (rounded, so that Newton meets no kink). The displacement is finite
and the tips go on pressing as they move. The touching points and their pressure are those of the
step before, in steps of a tenth of a millimetre; with stick they are those of the press.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim.fem.body import require_ngsolve
from tactibench_sim.fem.continuation import Continuation
from tactibench_sim.fem.field import SpatialField
from tactibench_sim.fem.press import SPATIAL, SpatialPress
from tactibench_sim.fem.tip import Tip, rounded_energy

Array = npt.NDArray[np.float64]
STICK = math.inf
_TIE = 100.0  # E_skin / mm, of skin that sticks
# Softer where the skin may slip, so that Newton converges; it follows by .99 of stuck skin.
_SLIDING_TIE = 4.0
_ROUNDING_MM = 2e-3
_STEP_MM = 0.1
_SETTINGS = replace(SPATIAL, first=0.1, smallest=1e-3, largest=0.25, steps=25)


class Drag:
    """The tips of a press at rest, moved sideways from there."""

    def __init__(self, press: SpatialPress, direction: Array, friction: float) -> None:
        """Begin at the present state of ``press``, which the drag then changes.

        Args:
            press: Tips that have been pressed without friction.
            direction: (2,) unit vector of the move.
            friction: Coulomb's coefficient, or STICK.
        """
        ngs = require_ngsolve()
        self.press, self.direction, self.friction = press, direction, friction
        displacement = press.state.components[0]
        self._before, self._last = (ngs.GridFunction(displacement.space) for _ in range(2))
        self._before.vec.data = displacement.vec
        self._last.vec.data = displacement.vec
        self._moved, self._last_moved = ngs.Parameter(0.0), ngs.Parameter(0.0)
        energy, tangent = press.forms(self._contacts)
        self._path = Continuation(
            energy,
            press.state,
            self._moved.Set,
            displacement=press.space.Range(0),
            settings=_SETTINGS,
            tangent=tangent,
        )

    def move(self, way: float) -> SpatialField:
        """Move on to ``way`` mm from the start and return the field there.

        The forces in the field are computed for tips that did not move; do not use them.

        Raises:
            NotConvergedError: A run failed.
        """
        if self.friction == STICK:
            self._path.advance(way)
            return self.press.field()
        while self._path.level < way - 1e-9:
            self._path.advance(min(way, self._path.level + _STEP_MM))
            self._last.vec.data = self.press.state.components[0].vec
            self._last_moved.Set(self._path.level)
        return self.press.field()

    def force(self) -> float:
        """Return the force of all tips along the move, E_skin mm^2."""
        ngs = require_ngsolve()
        form = ngs.BilinearForm(self.press.space, symmetric=True)
        for term in self._contacts(self.press.space.TrialFunction()[0]):
            form += term
        resisting = self.press.state.vec.CreateVector()
        form.Apply(self.press.state.vec, resisting)
        unit = ngs.GridFunction(self.press.space)
        unit.components[0].Set((*map(float, self.direction), 0.0))
        half = 2.0 if self.press.mirror else 1.0
        return -half * float(ngs.InnerProduct(resisting, unit.vec))

    def _contacts(self, u: Any) -> list[Any]:
        ngs, press = require_ngsolve(), self.press
        skin = ngs.ds(definedon=press.mesh.Boundaries("outer"))
        way = [float(part) * self._moved for part in self.direction] + [0.0]
        moved = [axis + u[i] - way[i] for i, axis in enumerate((ngs.x, ngs.y, ngs.z))]
        slip = [u[i] - self._before[i] - way[i] for i in range(3)]
        terms = []
        for tip, depth in zip(press.tips, press.depths, strict=True):
            pushed = rounded_energy(tip.inside(moved, float(depth)), tip.cushion)
            held = self._friction_energy(tip, float(depth), slip)
            terms += [ngs.Variation(term.Compile() * skin) for term in (pushed, held)]
        return terms

    def _friction_energy(self, tip: Tip, depth: float, slip: list[Any]) -> Any:
        """Return an energy per area whose force is a spring's, at most friction times pressure."""
        ngs = require_ngsolve()
        pressure, normal = self._contact(tip, depth)
        along = sum(a * b for a, b in zip(slip, normal, strict=True))
        square = sum((a - along * b) ** 2 for a, b in zip(slip, normal, strict=True))
        touching = ngs.IfPos(pressure, 1.0, 0.0)
        if self.friction == STICK:
            return touching * _TIE / 2 * square
        most = self.friction * pressure
        rounding = most / _SLIDING_TIE + _ROUNDING_MM
        return touching * most * (ngs.sqrt(square + rounding * rounding) - rounding)

    def _contact(self, tip: Tip, depth: float) -> tuple[Any, list[Any]]:
        """Return the pressure of a tip on the skin, and its outward normal, after the last step."""
        ngs = require_ngsolve()
        way = [float(part) * self._last_moved for part in self.direction] + [0.0]
        axes = (ngs.x, ngs.y, ngs.z)
        last = [axis + self._last[i] - way[i] for i, axis in enumerate(axes)]
        inside = tip.inside(last, depth)
        e = tip.cushion.rounding
        pressure = tip.cushion.penalty * ngs.IfPos(
            inside - e, inside - e / 2, ngs.IfPos(inside, inside * inside / (2 * e), 0.0)
        )
        return pressure, _normal(tip, last, depth)


def _normal(tip: Tip, place: list[Any], depth: float) -> list[Any]:
    """Return the outward normal of a tip's surface at a place that touches it."""
    if math.isinf(tip.radius):
        return [float(part) for part in tip.axis]
    ngs = require_ngsolve()
    q = [place[i] - float(part) for i, part in enumerate(tip.centre(depth))]
    above = sum(a * float(b) for a, b in zip(q, tip.axis, strict=True))
    rod = ngs.IfPos(above, above, 0.0)  # beside the rod the normal is that of a cylinder
    side = [a - rod * float(b) for a, b in zip(q, tip.axis, strict=True)]
    length = ngs.sqrt(sum(a * a for a in side) + 1e-20)
    return [a / length for a in side]
