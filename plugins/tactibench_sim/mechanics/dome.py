"""The displacement of the pressed dome, from tables of single contacts.

The field of a press starts from sum_i a_i T(angle to n_i; s_i) with T the tabulated single-contact
field. Tier ``superpose``: a_i = 1, s_i = delta_i. Tier ``coupled``: a_i = e_i / s_i with effective
depths e_i >= 0 such that every tip still reaches its depth or is clear of the skin,

    e_i >= 0,   g_i = sum_j a_j w(angle(n_i, n_j); s_j) - delta_i >= 0,   e_i g_i = 0,

and s_i = max(delta_i, sum_j e_j same(n_i, n_j)) the depth whose shape tip i presses into the skin;
``same`` is 1 for tips at one place and 0 from 1 mm on. So two coincident tips count as one
(a_1 + a_2 = 1), a tip that lies in another's dimple carries nothing, and one in the bulge beside
another carries more. Only the terms that a scene needs are evaluated: one contact costs the same in
both tiers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim.compiled import plain
from tactibench_sim.mechanics.contact import Tips, check_reach
from tactibench_sim.mechanics.corrections import Corrections
from tactibench_sim.mechanics.kernels import (
    Around,
    Array,
    Index,
    Meridians,
    Pairs,
    couple,
    displace,
)
from tactibench_sim.mechanics.tables import LARGEST_MM, SMALLEST_MM, Table, Tables

TABLE_TIERS = ("coupled", "superpose")


class Mechanics(Protocol):
    """A tier: how contacts displace the dome.

    ``loads`` returns what the other methods of the same tier take. Their ``directions`` are (P, 3)
    unit vectors from the dome's centre.

    Attributes:
        tier: Name of the tier.
        inner: Radius of the inner skin, mm.
    """

    tier: str
    inner: float

    def loads(self, tips: Tips) -> Any:
        """Solve for the loads of S scenes.

        Raises:
            UserError: The tier cannot press one of the scenes.
        """
        ...

    def displacement(self, loads: Any, directions: Array) -> tuple[Array, Array]:
        """Return displacement of pin bases, mm, and turn of their normals, rad, each (S, P, 3)."""
        ...

    def pin_tips(self, loads: Any, directions: Array, length: float) -> Array:
        """Return the (S, P, 3) tips of pins of ``length`` mm, from the dome's centre, mm."""
        ...

    def skin(self, loads: Any, directions: Array) -> Array:
        """Return the (S, P) inward displacement of the outer skin, mm."""
        ...


def mechanics_for(tier: str, tables: Tables) -> Mechanics:
    """Return the mechanics of a tier.

    Raises:
        UserError: ``tier`` is no tier, or it is ``fem`` and NGSolve is not installed.
    """
    if tier in TABLE_TIERS:
        return TableMechanics(tables, tier)
    if tier == "fem":
        from tactibench_sim.mechanics.finite_elements import FemMechanics

        return FemMechanics(tables)
    raise UserError(f"the tier is {tier!r}; allowed: coupled, fem, superpose.")


@dataclass(frozen=True, eq=False)
class Loads:
    """The loads of S scenes with up to K contacts.

    Attributes:
        n: (S, K, 3) directions of the contacts.
        delta: (S, K) penetrations, mm.
        amplitude: (S, K) amplitudes a.
        shape: (S, K) shape depths s, mm.
        table: (S,) indices of the indenters.
        strength: (S, K, K) strengths of the pairs' corrections; 0: none.
    """

    n: Array
    delta: Array
    amplitude: Array
    shape: Array
    table: Index
    strength: Array


@dataclass(frozen=True, eq=False)
class Surface:
    """One surface of the dome: its single-contact fields and their corrections.

    Attributes:
        singles: T of every indenter.
        around: O of every indenter.
        pairs: C of one indenter.
    """

    singles: Meridians
    around: Around
    pairs: Pairs


class TableMechanics:
    """The dome by tables: loads of presses, the pins' tips and the outer skin's displacement.

    Raises:
        UserError: ``tier`` is none of TABLE_TIERS.
    """

    def __init__(self, tables: Tables, tier: str) -> None:
        if tier not in TABLE_TIERS:
            raise UserError(f"the tier is {tier!r}; allowed: {', '.join(TABLE_TIERS)}.")
        self.tier = tier
        self.radii = tuple(sorted(tables.by_radius))
        ordered = [tables.by_radius[radius] for radius in self.radii]
        self.deepest = ordered[0].deepest
        self._depth, self._force = ordered[0].delta, [t.fields["force"] for t in ordered]
        self.inner = float(tables.parameters["dome"]["outer"] - tables.parameters["dome"]["skin"])
        self.base = _surface(ordered, ("w", "t", "omega"), tables.corrections, "base")
        self.outer = _surface(ordered, ("w_outer", "t_outer"), tables.corrections, "skin")

    def loads(self, tips: Tips) -> Loads:
        """Solve for how the tips share the load.

        Raises:
            UserError: The tables have no such radius, or do not reach so deep or so near the rim.
        """
        table = self._table_indices(tips)
        n, delta = tips.directions()
        check_reach(n, delta, self.deepest)
        if self.tier == "superpose":
            shape = np.maximum(delta, 0.0)
            amplitude = (shape > 0).astype(np.float64)
            strength = np.zeros((*delta.shape, delta.shape[1]))
        else:
            amplitude, shape, strength = couple(
                self.outer.singles, self.outer.pairs, table, n, delta
            )
        return Loads(n, delta, amplitude, shape, table, strength)

    def forces(self, loads: Loads) -> Array:
        """Return the (S, K) normal force of every tip, in units of the skin's modulus times mm^2.

        A tip of amplitude a and shape depth s carries a F(s), with F the tabulated force of a
        single contact at the apex; 0 where it carries nothing.
        """
        tabulated = self._force_of(loads.shape)
        index = loads.table[:, None, None]
        single = np.take_along_axis(tabulated, np.broadcast_to(index, (*loads.shape.shape, 1)), 2)
        out: Array = loads.amplitude * np.maximum(single[..., 0], 0.0)
        return out

    @cached_property
    def _force_of(self) -> CubicSpline:
        return CubicSpline(self._depth, np.stack(self._force, axis=1))

    def _table_indices(self, tips: Tips) -> Index:
        table = np.searchsorted(self.radii, tips.radius).clip(max=len(self.radii) - 1)
        has_table = np.array(self.radii)[table] == tips.radius
        if not has_table.all():
            available = ", ".join("plate" if np.isinf(r) else f"{r:g} mm" for r in self.radii)
            missing = f"{tips.radius[~has_table][0]:g}"
            raise UserError(
                f"the indenter's radius is {missing} mm; this sensor has tables for: {available}. "
                "Press one of these, or take tactip-127 or tactip-331 without sensor.instance and "
                f"sensor.table: spheres of {SMALLEST_MM:g} to {LARGEST_MM:g} mm, and a plate."
            )
        return table

    def displacement(self, loads: Loads, directions: Array) -> tuple[Array, Array]:
        """Return the displacement of pin bases, mm, and the turn of their normals, rad.

        Args:
            loads: Loads of S scenes.
            directions: (P, 3) unit vectors from the dome's centre.

        Returns:
            u (S, P, 3) and q (S, P, 3): the normal b turns by |q| towards q.
        """
        return self._displace(self.base, loads, directions)

    def pin_tips(self, loads: Loads, directions: Array, length: float) -> Array:
        """Return the (S, P, 3) tips of pins of ``length`` mm, from the dome's centre, mm."""
        return tips_of_pins(self.inner, directions, self.displacement(loads, directions), length)

    def skin(self, loads: Loads, directions: Array) -> Array:
        """Return the (S, P) inward displacement of the outer skin, mm."""
        inward: Array = -(self.outer_displacement(loads, directions) * directions).sum(axis=-1)
        return inward

    def outer_displacement(self, loads: Loads, directions: Array) -> Array:
        """Return the (S, P, 3) displacement of the outer skin, mm."""
        return self._displace(self.outer, loads, directions)[0]

    def _displace(self, surface: Surface, loads: Loads, directions: Array) -> tuple[Array, Array]:
        field: tuple[Array, Array] = displace(
            loads.n,
            loads.delta,
            loads.amplitude,
            loads.shape,
            loads.table,
            loads.strength,
            surface.singles,
            surface.around,
            surface.pairs,
            plain(directions),
        )
        return field


def tips_of_pins(
    inner: float, directions: Array, displacement: tuple[Array, Array], length: float
) -> Array:
    """Return the (..., P, 3) tips of pins of ``length`` mm, from the dome's centre, mm.

    A pin is a lever: it stands on the inner skin and turns with its normal.

    Args:
        inner: Radius of the inner skin, mm.
        directions: (P, 3) unit vectors of the pins.
        displacement: u and q of the pin bases, each (..., P, 3), mm and rad.
        length: Length of the pins, mm.
    """
    u, q = displacement
    angle = np.sqrt((q * q).sum(axis=-1, keepdims=True))
    normal = directions * np.cos(angle) + q * np.sinc(angle / np.pi)
    tips: Array = inner * directions + u - length * normal
    return tips


def _surface(
    tables: list[Table], names: tuple[str, ...], corrections: Corrections, where: str
) -> Surface:
    depth, polar = tables[0].delta, tables[0].polar
    inward, *tangential = names
    sine = np.sin(polar)
    values = [
        [table.fields[inward], *(_over_sine(table.fields[name], sine) for name in tangential)]
        for table in tables
    ]
    # The compiled loops read three quantities; the outer skin has no tabulated turn.
    values = [[*each, *[np.zeros_like(each[0])] * (3 - len(each))] for each in values]
    radii = [table.radius for table in tables]
    return Surface(
        meridians(depth, polar, values),
        corrections.around(where, radii),
        corrections.pairs(where, radii),
    )


def _over_sine(field: Array, sine: Array) -> Array:
    """Divide an odd field by sin; the result is even, its value on the axis from its neighbours."""
    out = np.empty_like(field)
    out[:, 1:] = field[:, 1:] / sine[1:]
    out[:, 0] = (15 * out[:, 1] - 6 * out[:, 2] + out[:, 3]) / 10  # even quartic through three
    return out


def meridians(depth: Array, polar: Array, values: Sequence[Sequence[Array]]) -> Meridians:
    """Make tables of axisymmetric fields ready for look-up: a cubic spline in Hermite form.

    Depth is interpolated first, once per contact, which leaves one short table in the polar angle.
    All pins then look up in that table only.

    Args:
        depth: (D,) mm, uniform from 0.
        polar: (T,) rad, uniform from 0.
        values: M times Q tables (D, T), even in the polar angle, zero at depth 0.
    """
    stack = np.array(values, dtype=np.float64)
    stack[..., 0, :] = 0.0
    slope = CubicSpline(polar, stack, axis=-1, bc_type=("clamped", "not-a-knot"))(polar, 1)
    with_slope = np.stack([stack, slope], axis=-1)  # (M, Q, D, T, 2)
    rate = CubicSpline(depth, with_slope, axis=2)(depth, 1)
    m, q, d, t, _ = with_slope.shape
    order = (0, 2, 3, 1, 4)  # what one look-up needs lies together
    value, rate = (
        np.ascontiguousarray(array.transpose(order)).reshape(m, d, t, 2 * q)
        for array in (with_slope, rate)
    )
    return Meridians(value, rate, float(depth[1]), float(polar[1]))
