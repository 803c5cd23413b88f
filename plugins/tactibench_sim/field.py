"""Where the pin tips go: the fields of a press, from tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactibench import UserError
from tactibench_sim.contact import Tips, check_reach
from tactibench_sim.corrected import Corrections
from tactibench_sim.coupling import superpose
from tactibench_sim.dome_kernels import (
    Around,
    Array,
    Index,
    Meridians,
    Pairs,
    couple,
    displace,
)
from tactibench_sim.meridian import meridians
from tactibench_sim.table import Table, Tables

TIERS = ("coupled", "superpose")


@dataclass(frozen=True, eq=False)
class Loads:
    """Amplitudes a and shape depths s (S, K) of contacts at directions n (S, K, 3).

    delta: (S, K) penetrations, mm. table: (S,) index of the indenter. strength: (S, K, K) of the
    pairs' corrections, 0: none.
    """

    n: Array
    delta: Array
    amplitude: Array
    shape: Array
    table: Index
    strength: Array


@dataclass(frozen=True, eq=False)
class Surface:
    """What one surface of the dome does: its single-contact fields and their corrections."""

    singles: Meridians
    around: Around
    pairs: Pairs


class Mechanics:
    """The dome: loads of presses, the pins' tips and the outer skin's displacement."""

    def __init__(self, tables: Tables, tier: str) -> None:
        if tier not in TIERS:
            raise UserError(f"the tier is {tier!r}; allowed: {', '.join(TIERS)}.")
        self.tier = tier
        self.radii = tuple(sorted(tables.by_radius))
        ordered = [tables.by_radius[radius] for radius in self.radii]
        self.deepest = ordered[0].deepest
        self.inner = float(tables.parameters["dome"]["outer"] - tables.parameters["dome"]["skin"])
        self.base = _surface(ordered, ("w", "t", "omega"), tables.corrections, "base")
        self.outer = _surface(ordered, ("w_outer", "t_outer"), tables.corrections, "skin")

    def loads(self, tips: Tips) -> Loads:
        """Who carries how much. Raises UserError for tips that the tables do not reach."""
        n, delta, table = self.touching(tips)
        if self.tier == "superpose":
            amplitude, shape = superpose(delta)
            strength = np.zeros((*delta.shape, delta.shape[1]))
        else:
            amplitude, shape, strength = couple(
                self.outer.singles, self.outer.pairs, table, n, delta
            )
        return Loads(n, delta, amplitude, shape, table, strength)

    def touching(self, tips: Tips) -> tuple[Array, Array, Index]:
        """n, delta and table of ``Loads``. Raises UserError as ``loads``."""
        table = np.searchsorted(self.radii, tips.radius).clip(max=len(self.radii) - 1)
        known = np.array(self.radii)[table] == tips.radius
        if not known.all():
            there = ", ".join("plate" if np.isinf(r) else f"{r:g} mm" for r in self.radii)
            wanted = f"{tips.radius[~known][0]:g}"
            raise UserError(
                f"the indenter's radius is {wanted} mm; the simulator has tables for: {there}. "
                f"Make one with `tactibench sim tabulate OUT --radius {wanted}`, then give "
                "`--param sensor.table=OUT`."
            )
        n, delta = tips.directions()
        check_reach(n, delta, self.deepest)
        return n, delta, table

    def displacement(self, loads: Loads, directions: Array) -> tuple[Array, Array]:
        """Displacement u of pin bases, mm, and turn q of their normals, rad; both (S, P, 3).

        directions: (P, 3) unit vectors from the dome's centre. The normal b turns by |q| towards q.
        """
        return self._displace(self.base, loads, directions)

    def pin_tips(self, loads: Loads, directions: Array, length: float) -> Array:
        """(S, P, 3) tips of pins of ``length`` mm, from the dome's centre, mm."""
        u, q = self.displacement(loads, directions)
        angle = np.sqrt((q * q).sum(axis=-1, keepdims=True))
        normal = directions * np.cos(angle) + q * np.sinc(angle / np.pi)
        tips: Array = self.inner * directions + u - length * normal
        return tips

    def skin(self, loads: Loads, directions: Array) -> Array:
        """(S, P) inward displacement of the outer skin, mm."""
        inward: Array = -(self.outer_displacement(loads, directions) * directions).sum(axis=-1)
        return inward

    def outer_displacement(self, loads: Loads, directions: Array) -> Array:
        """(S, P, 3) displacement of the outer skin, mm."""
        return self._displace(self.outer, loads, directions)[0]

    def _displace(self, of: Surface, loads: Loads, directions: Array) -> tuple[Array, Array]:
        field: tuple[Array, Array] = displace(
            loads.n,
            loads.delta,
            loads.amplitude,
            loads.shape,
            loads.table,
            loads.strength,
            of.singles,
            of.around,
            of.pairs,
            np.ascontiguousarray(directions),
        )
        return field


def _surface(
    ordered: list[Table], names: tuple[str, ...], corrections: Corrections, where: str
) -> Surface:
    depth, polar = ordered[0].delta, ordered[0].polar
    inward, *tangential = names
    sine = np.sin(polar)
    values = [
        [one.fields[inward], *(_over(one.fields[name], sine) for name in tangential)]
        for one in ordered
    ]
    values = [[*each, *[np.zeros_like(each[0])] * (3 - len(each))] for each in values]
    radii = [one.radius for one in ordered]
    return Surface(
        meridians(depth, polar, values),
        corrections.around(where, radii),
        corrections.pairs(where, radii),
    )


def _over(field: Array, sine: Array) -> Array:
    """An odd field divided by sin: even and smooth, its value on the axis from its neighbours."""
    out = np.empty_like(field)
    out[:, 1:] = field[:, 1:] / sine[1:]
    out[:, 0] = (15 * out[:, 1] - 6 * out[:, 2] + out[:, 3]) / 10  # even quartic through three
    return out
