"""Tips that press the dome and go sideways with Coulomb's friction, in three dimensions.

Each touching point of the skin is tied to the tip by a spring along the tip's surface from an
*anchor*. Its force is at most the friction times the pressure (rounded, so that Newton meets no
kink). After every step the anchor of a point that slipped is drawn after it, until the spring holds
just the greatest force: so the skin remembers where it stuck. Tips first go down along -z, from
their own first touch on, then sideways along the dome's base.

A step is solved with a pressure and with normals that are known before: the normals of the step
before, and the pressure that the last two steps lead to. With the pressure of the step before alone
the friction lags, by 5 to 10 % 1 mm deep.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from elements import Continuation, require_ngsolve
from spatial import SPATIAL, SpatialField, SpatialPress, rounded_energy, surface_normal

Array = npt.NDArray[np.float64]
_STEP_MM = 1 / 12
_SETTINGS = replace(SPATIAL, first=_STEP_MM, largest=_STEP_MM, smallest=2e-3, steps=25)
_TIE = 10.0  # E_skin / mm; with twice as stiff springs steps fail
_ROUNDING_MM = 8e-4
_KEPT = 6.0
"""Stretch of the spring of a point that slips, in lengths over which the force is rounded: the
force is .986 of the greatest."""


class RubbingPress:
    """A press with friction.

    Attributes:
        forces: (K, 2, 3) normal and tangential forces on the skin after the last move, E_skin mm^2.
    """

    def __init__(
        self,
        press: SpatialPress,
        friction: float,
        depths: Array,
        direction: tuple[float, float] = (1.0, 0.0),
    ) -> None:
        """Begin above the dome.

        Args:
            press: Tips at rest, with a mesh for the whole way.
            friction: Coulomb's coefficient.
            depths: (K,) depths to which the tips go down, mm; they move as one holder.
            direction: Unit vector of the way sideways after that.
        """
        ngs = require_ngsolve()
        self.press, self.friction = press, friction
        self.forces = np.zeros((len(press.tips), 2, 3))
        self._goal, self._deepest = np.asarray(depths), float(np.max(depths))
        self._direction = (*direction, 0.0)
        displacement = press.state.components[0]
        self._skin = ngs.ds(definedon=press.mesh.Boundaries("outer"))
        flat = ngs.VectorH1(press.mesh, order=1, definedon=press.mesh.Boundaries("outer"))
        self._anchors = [ngs.GridFunction(flat) for _ in press.tips]
        # The state of this step (index 0), of the one before and of the one before that.
        self._u = [displacement, *(ngs.GridFunction(displacement.space) for _ in range(2))]
        self._depth = [[ngs.Parameter(-1.0) for _ in press.tips] for _ in range(3)]
        self._way = [ngs.Parameter(0.0) for _ in range(3)]
        self._set(0.0)
        energy, tangent = press.forms(self._contacts)
        self._path = Continuation(
            energy,
            press.state,
            self._set,
            displacement=press.space.Range(0),
            settings=_SETTINGS,
            tangent=tangent,
        )

    def depths(self, level: float) -> Array:
        """Return the (K,) depths of the tips, mm, when the deepest one has gone ``level`` mm."""
        return self._goal - max(self._deepest - level, 0.0)

    def move(self, level: float) -> SpatialField:
        """Go on to ``level`` mm, down and then sideways, and return the field there.

        Raises:
            NotConvergedError: A run failed.
        """
        while self._path.level < level - 1e-9:
            self._path.advance(min(level, self._path.level + _STEP_MM))
            if self._path.level >= level - 1e-9:
                self.forces = self._forces()
            self._remember()
        return self.press.field()

    def _forces(self) -> Array:
        """Return the forces of this step before the anchors move, at its integration points."""
        ngs, press = require_ngsolve(), self.press
        out = np.zeros((len(press.tips), 2, 3))
        resisting, shift = press.state.vec.CreateVector(), ngs.GridFunction(press.space)
        terms = self._contacts(press.space.TrialFunction()[0])  # pushed and held, tip by tip
        for number, term in enumerate(terms):
            k, kind = divmod(number, 2)
            form = ngs.BilinearForm(press.space, symmetric=True)
            form += term
            form.Apply(press.state.vec, resisting)
            for axis, unit in enumerate(np.eye(3)):
                shift.components[0].Set(tuple(map(float, unit)))
                out[k, kind, axis] = -ngs.InnerProduct(resisting, shift.vec)
            if press.mirror and press.tips[k].start[1] == 0:
                out[k, kind] *= [2.0, 0.0, 2.0]
        return out

    def _set(self, level: float) -> None:
        for parameter, depth in zip(self._depth[0], self.depths(level), strict=True):
            parameter.Set(float(depth))
        self._way[0].Set(max(level - self._deepest, 0.0))

    def _contacts(self, u: Any) -> list[Any]:
        ngs, terms = require_ngsolve(), []
        for k, tip in enumerate(self.press.tips):
            inside = tip.inside(self._place(u, 0), self._depth[0][k])
            pushed = rounded_energy(inside, tip.cushion)
            last, normal = self._state_of(k, 1, self._u[1])
            ahead = 2 * last - self._state_of(k, 2, self._u[2])[0]
            pressure = ngs.IfPos(last, ngs.IfPos(ahead, ahead, 0.0), 0.0)
            _, size, most = self._spring(k, u, pressure, normal)
            held = ngs.IfPos(pressure, 1.0, 0.0) * most * size
            terms += [ngs.Variation(term.Compile() * self._skin) for term in (pushed, held)]
        return terms

    def _place(self, u: Any, step: int) -> list[Any]:
        """Return the places of the skin, as a holder that did not go sideways sees them."""
        ngs = require_ngsolve()
        axes, way = (ngs.x, ngs.y, ngs.z), self._way[step]
        return [axis + u[i] - self._direction[i] * way for i, axis in enumerate(axes)]

    def _state_of(self, k: int, step: int, u: Any) -> tuple[Any, list[Any]]:
        """Return the pressure of tip k on the skin and its outward normal."""
        ngs, tip = require_ngsolve(), self.press.tips[k]
        place, depth = self._place(u, step), self._depth[step][k]
        inside, e = tip.inside(place, depth), tip.cushion.rounding
        pressure = tip.cushion.penalty * ngs.IfPos(
            inside - e, inside - e / 2, ngs.IfPos(inside, inside * inside / (2 * e), 0.0)
        )
        return pressure, surface_normal(tip, place, depth)

    def _spring(
        self, k: int, u: Any, pressure: Any, normal: list[Any]
    ) -> tuple[list[Any], Any, Any]:
        """Return the spring's stretch along the tip, its rounded length and the greatest force."""
        ngs = require_ngsolve()
        stretch = [a - self._anchors[k][i] for i, a in enumerate(self._relative(k, u))]
        along = sum(a * b for a, b in zip(stretch, normal, strict=True))
        slip = [a - along * b for a, b in zip(stretch, normal, strict=True)]
        most = self.friction * pressure
        rounding = most / _TIE + _ROUNDING_MM
        return slip, ngs.sqrt(sum(a * a for a in slip) + rounding * rounding), most

    def _relative(self, k: int, u: Any) -> list[Any]:
        """Return the displacement of the skin relative to tip k, mm."""
        axis, depth, way = self.press.tips[k].axis, self._depth[0][k], self._way[0]
        return [u[i] + depth * float(axis[i]) - self._direction[i] * way for i in range(3)]

    def _remember(self) -> None:
        """Draw the anchors of slipping points after them, and keep the state of the last steps."""
        ngs = require_ngsolve()
        for k in range(len(self.press.tips)):
            pressure, normal = self._state_of(k, 0, self._u[0])
            slip, size, most = self._spring(k, self._u[0], pressure, normal)
            most_mm = _KEPT * (most / _TIE + _ROUNDING_MM)
            kept = ngs.IfPos(pressure, ngs.IfPos(size - most_mm, most_mm / size, 1.0), 0.0)
            relative = self._relative(k, self._u[0])
            ends = [a - kept * b for a, b in zip(relative, slip, strict=True)]
            anchor = ngs.GridFunction(self._anchors[k].space)
            anchor.Set(tuple(ends), definedon=self.press.mesh.Boundaries("outer"))
            self._anchors[k].vec.data = anchor.vec
        for now, before in ((1, 2), (0, 1)):
            self._u[before].vec.data = self._u[now].vec
            self._way[before].Set(self._way[now].Get())
            for kept, parameter in zip(self._depth[before], self._depth[now], strict=True):
                kept.Set(parameter.Get())
