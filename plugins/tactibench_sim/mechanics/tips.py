"""The dome under tips of any radius: the nominal tables, and for other tips their own.

A scene has tips of one radius, so a batch of scenes is divided by radius and each part is computed
from its tables. Scenes of the published experiments, all R = 3 mm, are one part, at no extra cost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.dome import Loads, TableMechanics
from tactibench_sim.mechanics.kernels import Array, Index
from tactibench_sim.mechanics.tip_tables import shipped

_KEPT = 16
"""Number of radii whose tables stay in memory; a protocol presses tips of a few radii."""


@dataclass(frozen=True, eq=False)
class Part:
    """The scenes of a batch that have one radius.

    Attributes:
        rows: Rows of the scenes in the batch.
        mechanics: Mechanics of that radius.
        loads: Loads of these scenes.
    """

    rows: Index
    mechanics: TableMechanics
    loads: Loads


class TipMechanics:
    """Mechanics of spherical tips and plates on the nominal dome, by tables."""

    def __init__(self, nominal: TableMechanics) -> None:
        self.nominal, self.tier, self.inner = nominal, nominal.tier, nominal.inner
        self._others: dict[float, TableMechanics] = {}

    def loads(self, tips: Tips) -> tuple[Part, ...]:
        """Solve for how the tips share the load.

        Raises:
            UserError: The tables have no such radius, or do not reach so deep or so near the rim.
        """
        radii = np.unique(tips.radius)
        if np.isin(radii, self.nominal.radii).all():
            return (Part(np.arange(len(tips)), self.nominal, self.nominal.loads(tips)),)
        parts = []
        for radius in radii:
            rows = np.flatnonzero(tips.radius == radius)
            mechanics, some = self._of(float(radius)), tips.take(rows)
            parts.append(Part(rows, mechanics, mechanics.loads(some)))
        return tuple(parts)

    def _of(self, radius: float) -> TableMechanics:
        if radius in self.nominal.radii:
            return self.nominal
        if radius not in self._others:
            if len(self._others) == _KEPT:
                self._others.clear()
            self._others[radius] = TableMechanics(shipped().tables(radius), self.tier)
        return self._others[radius]

    def displacement(self, loads: tuple[Part, ...], directions: Array) -> tuple[Array, Array]:
        """Return displacement of pin bases, mm, and turn of their normals, rad, each (S, P, 3)."""
        fields = _joined(loads, lambda m, part: np.stack(m.displacement(part, directions), axis=1))
        return fields[:, 0], fields[:, 1]

    def pin_tips(self, loads: tuple[Part, ...], directions: Array, length: float) -> Array:
        """Return the (S, P, 3) tips of pins of ``length`` mm, from the dome's centre, mm."""
        return _joined(loads, lambda m, part: m.pin_tips(part, directions, length))

    def skin(self, loads: tuple[Part, ...], directions: Array) -> Array:
        """Return the (S, P) inward displacement of the outer skin, mm."""
        return _joined(loads, lambda m, part: m.skin(part, directions))

    def forces(self, loads: tuple[Part, ...]) -> Array:
        """Return the (S, K) normal force of every tip, E_skin mm^2."""
        return _joined(loads, lambda m, part: m.forces(part))


def _joined(parts: tuple[Part, ...], of: Callable[[TableMechanics, Loads], Array]) -> Array:
    """Return what ``of`` gives for each part, in the order of the batch."""
    if len(parts) == 1:
        return of(parts[0].mechanics, parts[0].loads)
    results = [of(part.mechanics, part.loads) for part in parts]
    out = np.empty((sum(map(len, results)), *results[0].shape[1:]))
    for part, values in zip(parts, results, strict=True):
        out[part.rows] = values
    return out
