"""Sticking contact: what has touched keeps its distance from the axis on the indenter.

The other limit of friction, infinite where it touches. A point's place on the indenter is taken
where it first touched, interpolated within the increment; from the next increment on it is tied to
that place by a penalty. So the result depends on the increments: see ``STEP_MM``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tactibench_sim.fem.extra import require_ngsolve

STEP_MM = 0.05
"""Largest increment of a sticking press; half of it changes pin bases by less than 0.01 mm."""


class Stick:
    """The tie on boundary "outer"; inside, across: overlap and radial displacement of the state.

    Both are NGSolve functions; ``update`` is called at every equilibrium. For a sphere the tie
    holds up to its equator, beyond which the skin may slide along the rod.
    """

    def __init__(self, mesh: Any, inside: Any, across: Any, penalty: float) -> None:
        ngs = require_ngsolve()
        self._where = mesh.Boundaries("outer")
        self._now = {"inside": inside, "across": across}
        space = ngs.H1(mesh, order=1, definedon=self._where)
        self._inside, self._across, self._place = (ngs.GridFunction(space) for _ in range(3))
        self._penalty = penalty
        self._inside.Set(inside, definedon=self._where)

    def energy(self, across: Any) -> Any:
        """Energy of the tie per area of a trial radial displacement."""
        ngs = require_ngsolve()
        moved = across - self._place
        return self._penalty / 2 * ngs.IfPos(self._inside, moved * moved, 0.0)

    def update(self, _level: float = 0.0) -> None:
        """Give what has touched since the last equilibrium its place, release what has left."""
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
