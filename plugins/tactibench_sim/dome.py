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

A scene has tips of one radius, so a batch of scenes is divided by radius, and each part is computed
from the tables of its tips. Scenes of the published experiments, all R = 3 mm, are one part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim.compiled import plain
from tactibench_sim.contact import Tips, check_reach
from tactibench_sim.kernels import (
    Around,
    Array,
    Index,
    Meridians,
    Pairs,
    couple,
    displace,
    push_aside,
)
from tactibench_sim.tables import (
    LARGEST_MM,
    RADIUS_MM,
    SMALLEST_MM,
    Corrections,
    Table,
    Tables,
    tip_tables,
)

TIERS = ("coupled", "superpose")
RIM_PER_MM = 0.12
"""How the clamped rim stiffens the dome towards it. By finite elements the force of a tip of R = 3
mm 40 deg from the apex is 1 % above that at the apex 1 mm deep and 4 % 6 mm deep; at 55 deg, 2 and
13 %. The term is within 1 % of them."""
_CLAMP_RAD, _LINE = np.radians(88.0), 4
"""Nearer to the clamp the tabulated turn is that of an element at its edge, twice as large. Pins so
far from a contact beside the apex are not at the clamp: finite elements turn them less."""
NEAR_RATIO = 1.1
"""Ratio of radii over which the nominal tip's tables pass into those of other tips."""
_KEPT = 16
"""Number of radii whose splines stay in memory; a protocol presses tips of a few radii."""


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


class Splines:
    """Tables of a few indenters, ready for look-up.

    Attributes:
        radii: Radii of the indenters, mm, ascending.
        deepest: Greatest tabulated penetration, mm.
        base: The inner skin, on which the pins stand.
        outer: The outer skin.
    """

    def __init__(self, tables: Tables) -> None:
        self.radii = tuple(sorted(tables.by_radius))
        self._tables = [tables.by_radius[radius] for radius in self.radii]
        self.deepest = float(self._tables[0].delta[-1])
        self.base = _surface(self._tables, ("w", "t", "omega"), tables.corrections, "base")
        self.outer = _surface(self._tables, ("w_outer", "t_outer"), tables.corrections, "skin")

    @cached_property
    def force_of(self) -> CubicSpline:
        """Penetration, mm -> (M,) forces of single contacts at the apex, E_skin mm^2."""
        forces = [table.fields["force"] for table in self._tables]
        return CubicSpline(self._tables[0].delta, np.stack(forces, axis=1))


@dataclass(frozen=True, eq=False)
class Loads:
    """The loads of the S scenes of a batch whose tips have tables in common, up to K contacts each.

    Attributes:
        rows: (S,) rows of the scenes in the batch.
        splines: Tables of their tips.
        n: (S, K, 3) directions of the contacts.
        delta: (S, K) penetrations, mm.
        amplitude: (S, K) amplitudes a.
        shape: (S, K) shape depths s, mm.
        table: (S,) indices of the indenters.
        strength: (S, K, K) strengths of the pairs' corrections; 0: none.
        weight: Share of these loads in the field of their scenes.
    """

    rows: Index
    splines: Splines
    n: Array
    delta: Array
    amplitude: Array
    shape: Array
    table: Index
    strength: Array
    weight: float = 1.0


class TableMechanics:
    """The dome by tables: loads of presses, the pins' tips and the outer skin's displacement.

    ``directions`` are (P, 3) unit vectors from the dome's centre.

    Attributes:
        tier: Name of the tier.
        inner: Radius of the inner skin, mm.
    """

    def __init__(self, tables: Tables, tier: str, *, other_tips: bool = False) -> None:
        """Make the tables ready for look-up.

        Args:
            tables: Tables of the dome.
            tier: One of TIERS.
            other_tips: Whether spheres of other radii press, too; their tables are of the nominal
                dome.

        Raises:
            UserError: ``tier`` is none of TIERS.
        """
        if tier not in TIERS:
            raise UserError(f"the tier is {tier!r}; allowed: {', '.join(TIERS)}.")
        self.tier = tier
        self.inner = float(tables.parameters["dome"]["outer"] - tables.parameters["dome"]["skin"])
        self.nominal, self.other_tips = Splines(tables), other_tips
        self._other = lru_cache(_KEPT)(lambda radius: Splines(tip_tables(radius)))

    def loads(self, tips: Tips) -> tuple[Loads, ...]:
        """Solve for how the tips share the load.

        Raises:
            UserError: The tables have no such radius, or do not reach so deep or so near the rim.
        """
        known = self.nominal.radii
        if np.isin(tips.radius, known).all():
            return (self._solve(np.arange(len(tips)), self.nominal, tips, tips.radius),)
        loads = []
        for radius in np.unique(tips.radius).tolist():
            if radius not in known and not self.other_tips:
                available = ", ".join("plate" if np.isinf(r) else f"{r:g} mm" for r in known)
                raise UserError(
                    f"the indenter's radius is {radius:g} mm; this sensor has tables for: "
                    f"{available}. Press one of these, or take tactip-127 or tactip-331 without "
                    f"sensor.instance and sensor.table: spheres of {SMALLEST_MM:g} to "
                    f"{LARGEST_MM:g} mm, and a plate."
                )
            rows = np.flatnonzero(tips.radius == radius)
            share = nominal_share(radius) if radius not in known else 1.0
            if share:
                nearest = np.full(len(rows), radius if radius in known else RADIUS_MM)
                loads.append(self._solve(rows, self.nominal, tips.take(rows), nearest, share))
            if share < 1:
                own = np.full(len(rows), radius)
                part = self._solve(rows, self._other(radius), tips.take(rows), own, 1 - share)
                loads.append(part)
        return tuple(loads)

    def _solve(
        self, rows: Index, splines: Splines, tips: Tips, tabulated: Array, weight: float = 1.0
    ) -> Loads:
        table = np.searchsorted(splines.radii, tabulated)
        n, delta = tips.directions()
        check_reach(n, delta, splines.deepest)
        if self.tier == "superpose":
            shape = np.maximum(delta, 0.0)
            amplitude = (shape > 0).astype(np.float64)
            strength = np.zeros((*delta.shape, delta.shape[1]))
        else:
            skin = splines.outer
            amplitude, shape, strength = couple(skin.singles, skin.pairs, table, n, delta)
        return Loads(rows, splines, n, delta, amplitude, shape, table, strength, weight)

    def forces(self, loads: tuple[Loads, ...]) -> Array:
        """Return the (S, K) normal force of every tip, in units of the skin's modulus times mm^2.

        A tip of amplitude a and shape depth s carries a F(s) (1 + RIM s (1 - cos b)^2), with F the
        tabulated force of a single contact at the apex and b the tip's angle from it; 0 where it
        carries nothing.
        """
        return _joined(loads, _forces)

    def contact_forces(self, loads: tuple[Loads, ...]) -> Array:
        """Return the (S, K, 3) forces of the tips on the skin, E_skin mm^2: along -n."""
        return _joined(loads, lambda part: -_forces(part)[..., None] * part.n)

    def push_aside(self, loads: tuple[Loads, ...]) -> Array:
        """Return (S, K, 3) mm: how far the others' normal loads move the outer skin under a tip."""
        return _joined(loads, _push_aside)

    def displacement(self, loads: tuple[Loads, ...], directions: Array) -> tuple[Array, Array]:
        """Return the displacement of pin bases, mm, and the turn of their normals, rad.

        Args:
            loads: Loads of S scenes.
            directions: (P, 3) unit vectors from the dome's centre.

        Returns:
            u (S, P, 3) and q (S, P, 3): the normal b turns by |q| towards q.
        """
        at = plain(directions)
        if len(loads) == 1:
            return _displace(loads[0], loads[0].splines.base, at)
        fields = _joined(
            loads, lambda part: np.stack(_displace(part, part.splines.base, at), axis=1)
        )
        return plain(fields[:, 0]), plain(fields[:, 1])  # loops that add to them take no other

    def pin_tips(self, loads: tuple[Loads, ...], directions: Array, length: float) -> Array:
        """Return the (S, P, 3) tips of pins of ``length`` mm, from the dome's centre, mm."""
        return tips_of_pins(self.inner, directions, self.displacement(loads, directions), length)

    def outer(self, loads: tuple[Loads, ...], directions: Array) -> Array:
        """Return the (S, P, 3) displacement of the outer skin, mm."""
        at = plain(directions)
        return _joined(loads, lambda part: _displace(part, part.splines.outer, at)[0])

    def skin(self, loads: tuple[Loads, ...], directions: Array) -> Array:
        """Return the (S, P) inward displacement of the outer skin, mm."""
        inward: Array = -(self.outer(loads, directions) * directions).sum(axis=-1)
        return inward


def nominal_share(radius: float) -> float:
    """Return the share, 0 to 1, of the nominal tip's tables in the field of a tip beside it.

    Both sets of tables come from their own elements and differ by about 0.01 mm. The share is 1 at
    the nominal radius and ends at NEAR_RATIO, so that a radius changes the field smoothly.

    Args:
        radius: Radius, mm.
    """
    x = max(1.0 - abs(math.log(radius / RADIUS_MM)) / math.log(NEAR_RATIO), 0.0)
    return x * x * (3.0 - 2.0 * x)


def _forces(loads: Loads) -> Array:
    tabulated = loads.splines.force_of(loads.shape)
    index = np.broadcast_to(loads.table[:, None, None], (*loads.shape.shape, 1))
    single = np.take_along_axis(tabulated, index, 2)[..., 0]
    stiffer = 1 + RIM_PER_MM * loads.shape * (1 - loads.n[..., 2]) ** 2
    out: Array = loads.amplitude * np.maximum(single, 0.0) * stiffer
    return out


def _push_aside(loads: Loads) -> Array:
    skin = loads.splines.outer
    out: Array = push_aside(
        skin.singles,
        skin.pairs,
        loads.table,
        loads.n,
        loads.delta,
        loads.amplitude,
        loads.shape,
        loads.strength,
    )
    return out


def _displace(loads: Loads, surface: Surface, directions: Array) -> tuple[Array, Array]:
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
        directions,
    )
    return field


def _joined(parts: Sequence[Loads], of: Callable[[Loads], Array]) -> Array:
    """Return what ``of`` gives for the scenes, in the order of the batch."""
    if len(parts) == 1:
        return of(parts[0])
    results = [of(part) for part in parts]
    scenes = 1 + max(int(part.rows.max()) for part in parts)
    out = np.zeros((scenes, *results[0].shape[1:]))
    for part, values in zip(parts, results, strict=True):
        out[part.rows] += part.weight * values
    return out


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
    tips: Array = inner * directions + u - length * turned_normals(directions, q)
    return tips


def turned_normals(directions: Array, turn: Array) -> Array:
    """Return the (..., P, 3) outward normals (P, 3) after their turn q (..., P, 3), rad."""
    angle = np.sqrt((turn * turn).sum(axis=-1, keepdims=True))
    normals: Array = directions * np.cos(angle) + turn * np.sinc(angle / np.pi)
    return normals


def _surface(
    tables: list[Table], names: tuple[str, ...], corrections: Corrections, where: str
) -> Surface:
    depth, polar = tables[0].delta, tables[0].polar
    inward, *tangential = names
    sine = np.sin(polar)
    values = [
        [table.fields[inward], *(_over_sine(_odd(table, name), sine) for name in tangential)]
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


def _odd(table: Table, name: str) -> Array:
    """Return a tangential displacement or the turn; the turn goes straight on into the clamp."""
    field, last = table.fields[name], int(np.searchsorted(table.polar, _CLAMP_RAD))
    if name != "omega":
        return field
    rate = (field[:, last] - field[:, last - _LINE]) / _LINE
    beyond = np.arange(1, len(table.polar) - last)
    out = field.copy()
    out[:, last + 1 :] = field[:, last, None] + rate[:, None] * beyond
    return out


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
