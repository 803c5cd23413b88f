"""Tier ``auto``: the cheapest tier whose measured error bound for a scene meets a tolerance.

Where no table tier meets it, the better one is taken, or finite elements where they are allowed.
``green`` is never taken: it costs more than ``coupled`` and is no better (see docs/simulator.md).

The bounds were measured against three-dimensional finite elements (see ``bounds``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim.bounds import bounds_for
from tactibench_sim.contact import Tips
from tactibench_sim.coupling import superpose
from tactibench_sim.dome_kernels import Array, Index, couple
from tactibench_sim.field import Loads, Mechanics
from tactibench_sim.table import Tables

DEFAULT_TOLERANCE_MM = 0.10

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class AutoLoads(Loads):
    """rows: scenes that finite elements made, whose field is ``solved``."""

    rows: Index
    solved: Any


class AutoMechanics(Mechanics):
    """Chooses between ``superpose`` and ``coupled`` (and, if allowed, ``fem``) scene by scene."""

    def __init__(
        self,
        tables: Tables,
        tolerance: float = DEFAULT_TOLERANCE_MM,
        allow_fem: bool = False,
    ) -> None:
        super().__init__(tables, "coupled")
        self.tier = "auto"
        self.tolerance, self.allow_fem = tolerance, allow_fem
        self._given = tables
        self.bounds = bounds_for(tables.digest)
        # The bounds hold for the indenter whose pairs were measured.
        self.known = self.base.pairs.indenter

    def loads(self, tips: Tips) -> Loads:
        """Loads of the tier each scene takes. Raises UserError as ``Mechanics.loads``."""
        n, delta, table, coupled, unmet = self._choose(tips)
        amplitude, shape = superpose(delta)
        rows = np.flatnonzero(coupled)
        strength = np.zeros((*delta.shape, delta.shape[1]))
        if len(rows):
            amplitude[rows], shape[rows], strength[rows] = couple(
                self.outer.singles, self.outer.pairs, table[rows], n[rows], delta[rows]
            )
        loads = Loads(n, delta, amplitude, shape, table, strength)
        rows = np.flatnonzero(unmet)
        if not self.allow_fem or not len(rows):
            return loads
        from tactibench_sim.fem_tier import FemMechanics

        fem = FemMechanics(self._given)
        solved = fem, fem.loads(Tips(tips.xy[rows], tips.depth[rows], tips.radius[rows]))
        return AutoLoads(**vars(loads), rows=rows, solved=solved)

    def displacement(self, loads: Loads, directions: Array) -> tuple[Array, Array]:
        u, q = super().displacement(loads, directions)
        if isinstance(loads, AutoLoads):
            fem, solved = loads.solved
            u[loads.rows], q[loads.rows] = fem.displacement(solved, directions)
        return u, q

    def outer_displacement(self, loads: Loads, directions: Array) -> Array:
        u = super().outer_displacement(loads, directions)
        if isinstance(loads, AutoLoads):
            fem, solved = loads.solved
            u[loads.rows] = fem.outer_displacement(solved, directions)
        return u

    def taken(self, tips: Tips) -> dict[str, int]:
        """How many scenes take which tier, and how many meet the tolerance with none."""
        _, _, _, coupled, unmet = self._choose(tips)
        fem = unmet & self.allow_fem
        return {
            "superpose": int((~coupled & ~fem).sum()),
            "coupled": int((coupled & ~fem).sum()),
            "fem": int(fem.sum()),
            "tolerance_unmet": int((unmet & ~fem).sum()),
        }

    def _choose(self, tips: Tips) -> tuple[Array, Array, Index, Flags, Flags]:
        """n, delta, table, who is coupled, and for whom no table tier is good enough."""
        n, delta, table = self.touching(tips)
        cheap, dear = self._bounds(n, delta, table)
        coupled = (cheap > self.tolerance) & ((delta > 0).sum(axis=1) > 1)
        return n, delta, table, coupled, np.minimum(cheap, dear) > self.tolerance

    def _bounds(self, n: Array, delta: Array, table: Index) -> tuple[Array, Array]:
        """(S,) bounds of ``superpose`` and of ``coupled``, mm."""
        depth = np.maximum(delta, 0.0)
        deepest, count = depth.max(axis=1), (depth > 0).sum(axis=1)
        if self.bounds is None:
            unknown = np.where(count > 0, np.inf, 0.0)
            return unknown, unknown
        bounds = self.bounds
        lowest = np.where(depth > 0, n[..., 2], 1.0).min(axis=1)
        single = bounds.alone(np.arccos(np.clip(lowest, -1.0, 1.0)), deepest)
        cheap = single.copy()
        for i in range(delta.shape[1]):
            for j in range(i + 1, delta.shape[1]):
                rows = np.flatnonzero((depth[:, i] > 0) & (depth[:, j] > 0))
                if len(rows):
                    cosine = np.clip((n[rows, i] * n[rows, j]).sum(axis=1), -1.0, 1.0)
                    cheap[rows] += bounds.superposing(
                        np.arccos(cosine), depth[rows, i], depth[rows, j]
                    )
        many = bounds.by_depth(bounds.many, deepest)
        cheap = np.where(count > 2, cheap + many, cheap)
        pair = bounds.by_depth(bounds.pair, deepest)
        dear = np.select([count < 2, count == 2], [single, pair], many)
        foreign = (count > 1) & (table != self.known)
        cheap, dear = (np.where(foreign, np.inf, bound) for bound in (cheap, dear))
        return cheap, dear
