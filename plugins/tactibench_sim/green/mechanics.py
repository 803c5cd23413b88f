"""Tier ``green``: the displacement of scenes of any radius.

    u = sum_i f_i S_i + (the lattice's answer together) - sum_i f_i (the lattice's answer to tip i)

S_i is tip i alone, computed with rings or tabulated: exactly symmetric about its axis. The lattice
knows how the tips share the load; f_i, the part of its own force that tip i still carries (0..1),
takes out what the lattice says of a tip alone, so that its discretisation is seen only where tips
interact. One tip is S_1 to the last bit; coincident tips are one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_sim.green import fields, lattice, scene
from tactibench_sim.green.kernel import Kernel
from tactibench_sim.green.lookup import Array, at_cap, cubic_row
from tactibench_sim.green.shapes import DEEPEST_MM, Shape, shape
from tactibench_sim.green.single import footprint
from tactibench_sim.mechanics.contact import Tips, check_reach
from tactibench_sim.mechanics.tables import Tables

NEAR_MM = 0.3
"""Tips this far above the skin may still be met by a bulge."""


@dataclass(frozen=True, eq=False)
class Sources:
    """Forces of one scene. direction: (N, 3), weight: (N,), table: (N,), tables: (T, C, 4, 4).

    force: (K,) total of each tip, E_skin mm^2, in the order of the tips.
    """

    direction: Array
    weight: Array
    table: npt.NDArray[np.intp]
    tables: Array
    force: Array


class GreenMechanics:
    """The dome under any spherical tips and plates."""

    tier = "green"
    deepest = DEEPEST_MM

    def __init__(self, kernel: Kernel, tables: Tables | None = None) -> None:
        """Take finite-element fields of single contacts from tables where a radius has them."""
        self.kernel = kernel
        self._tables = {} if tables is None else dict(tables.by_radius)
        self.inner, self.outer = kernel.inner, kernel.outer
        self._shapes: dict[float, Shape] = {}
        self._hexagon = lattice.hexagon()

    def shape(self, radius: float) -> Shape:
        """Return the single contacts of a radius, made the first time and kept."""
        if radius not in self._shapes:
            self._shapes[radius] = shape(self.kernel, radius, self._tables.get(radius))
        return self._shapes[radius]

    def loads(self, tips: Tips) -> list[Sources]:
        """Solve every scene. Raises UserError for a press that the tier does not know."""
        n, delta = tips.directions()
        if not (np.isfinite(tips.radius) | np.isinf(tips.radius)).all():
            raise UserError("an indenter's radius is not a number; give it in mm.")
        check_reach(n, delta, self.deepest)
        return [self._sources(float(r), n[s], delta[s]) for s, r in enumerate(tips.radius)]

    def displacement(self, loads: list[Sources], directions: Array) -> tuple[Array, Array]:
        """Return u (S, P, 3) mm of the inner skin at directions (P, 3), and its derivative.

        The derivative (S, P, 3, 3) times a unit tangent is the change of u along it, mm per rad.
        """
        return self._displace(loads, directions, fields.INNER)

    def outer_displacement(self, loads: list[Sources], directions: Array) -> tuple[Array, Array]:
        """Return ``displacement`` of the outer skin."""
        return self._displace(loads, directions, fields.OUTER)

    def normals(self, loads: list[Sources], directions: Array) -> tuple[Array, Array]:
        """Return u (S, P, 3) mm and outward unit normals (S, P, 3) of the deformed inner skin."""
        u, slope = self.displacement(loads, directions)
        ends = np.array([lattice.basis(b) for b in directions])  # (P, 2, 3)
        tangents = self.inner * ends + np.einsum("spij,pkj->spki", slope, ends)
        normal = np.cross(tangents[:, :, 0], tangents[:, :, 1])
        sign = np.sign((np.cross(ends[:, 0], ends[:, 1]) * directions).sum(axis=-1))
        normal *= (sign / np.linalg.norm(normal, axis=-1))[..., None]
        return u, normal

    def pin_tips(self, loads: list[Sources], directions: Array, length: float) -> Array:
        """Return (S, P, 3) tips of pins of ``length`` mm, from the dome's centre, mm."""
        u, normal = self.normals(loads, directions)
        tips: Array = self.inner * directions + u - length * normal
        return tips

    def skin(self, loads: list[Sources], directions: Array) -> Array:
        """Return the (S, Q) inward displacement of the outer skin, mm."""
        out = np.zeros((len(loads), len(directions)))
        at = np.ascontiguousarray(directions)
        for row, s in zip(out, loads, strict=True):
            fields.inward(s.direction, s.weight, s.table, s.tables, self.kernel.step, at, row)
        return out

    def _displace(self, loads: list[Sources], at: Array, layer: int) -> tuple[Array, Array]:
        u, slope = np.zeros((len(loads), len(at), 3)), np.zeros((len(loads), len(at), 3, 3))
        at = np.ascontiguousarray(at)
        for k, s in enumerate(loads):
            fields.displace(
                s.direction,
                s.weight,
                s.table,
                s.tables,
                self.kernel.step,
                at,
                layer,
                u[k],
                slope[k],
            )
        return u, slope

    def _sources(self, radius: float, n: Array, delta: Array) -> Sources:
        force = np.zeros(len(delta))
        near = np.flatnonzero(delta > -NEAR_MM)
        touching = np.flatnonzero(delta > 0)
        if not len(touching):
            cells = self.kernel.modes.shape[1:]
            none = np.zeros(0, dtype=np.intp)
            return Sources(np.zeros((0, 3)), np.zeros(0), none, np.zeros((0, *cells)), force)
        one = self.shape(radius)
        if len(near) == 1:
            force[near] = np.interp(delta[near], one.depth, one.force)
            return Sources(
                n[near],
                np.ones(1),
                np.zeros(1, dtype=np.intp),
                _at(one.depth, one.tableaus, delta[near]),
                force,
            )
        order = near[np.lexsort((*n[near].T, -delta[near]))]
        return self._together(one, n, delta, order, force)

    def _together(
        self, one: Shape, n: Array, delta: Array, order: npt.NDArray[np.intp], force: Array
    ) -> Sources:
        k, n, d = self.kernel, np.ascontiguousarray(n[order]), delta[order]
        deep = np.maximum(d, 0.0)
        finest = float(np.exp(k.log_cap[0])) / scene.CAP
        spacing = np.array([footprint(one.radius, x, self.outer) for x in deep]) / lattice.RINGS
        spacing = np.maximum(spacing, finest)
        alone = _at(one.depth, one.load, deep)
        at, together, single, soft, soft_alone, settled = scene.press(
            self._hexagon,
            n,
            d,
            one.radius,
            self.outer,
            spacing,
            alone,
            k.step,
            k.log_cap,
            k.caps,
            k.modes,
            k.force,
            k.shares,
        )
        if not settled:
            raise UserError(
                f"the tier green found no equilibrium for {len(d)} tips of radius "
                f"{one.radius:g} mm, {d.max():g} mm deep; press less deep or take another tier."
            )
        total, own = together.sum(axis=1), single.sum(axis=1)
        part = np.divide(total, own, out=np.zeros_like(total), where=own > 0).clip(0.0, 1.0)
        caps = np.stack([at_cap(k.log_cap, k.caps, scene.CAP * s) for s in spacing])
        tables = np.concatenate(
            [
                _at(one.depth, one.tableaus, deep),
                caps + np.tensordot(soft, k.modes, 1),
                caps + np.tensordot(soft_alone, k.modes, 1),
            ]
        )
        count, size = together.shape
        index = np.concatenate([np.arange(count), np.repeat(np.arange(count, 3 * count), size)])
        directions = np.concatenate([n, at.reshape(-1, 3), at.reshape(-1, 3)])
        weight = np.concatenate([part, together.ravel(), -(part[:, None] * single).ravel()])
        use = np.flatnonzero(weight)
        force[order] = total
        return Sources(directions[use], weight[use], index[use], tables, force)


def _at(knots: Array, coefficients: Array, x: Array) -> Array:
    """Return (N, ...) cubics over knots, (4, K - 1, ...) highest power first, at each x."""
    rows = []
    for one in x:
        cell, f = cubic_row(knots, float(one))
        a, b, c, d = coefficients[:, cell]
        rows.append(((a * f + b) * f + c) * f + d)
    return np.array(rows)
