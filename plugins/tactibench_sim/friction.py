"""Tips that stick to the skin and slip: what friction adds to the field of a press.

A tip moves sideways by m after it touched. The skin under it follows until the tip slips. The
sideways force of one tip is Mindlin's for a round contact (Compliance of elastic bodies in contact,
J. Appl. Mech. 16, 1949), which begins as m / C and ends at Coulomb's limit mu F,

    Q(m) = mu F (1 - (1 - min(|m| / (1.5 mu F C), 1))^1.5)    along m,

with C the compliance and F the tip's normal force. Where other tips already pull the skin along, m
is the rest of the way, so the forces are solved for together. The way that the skin followed,
s = C Q + sum over other tips, is a part of the way on which the tip did not slide: a spherical tip
presses the point of the skin that lies s before the place where it ends. It presses deeper where
other tips raise the skin. The field is that of the press there plus Q times the tabulated drag.
Left out are the twist of a tip about its own axis, what the clamped rim changes in the drag, and
what friction does on the way down.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tactibench import UserError
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.compiled import plain
from tactibench_sim.contact import SLACK, Array, Tips
from tactibench_sim.dome import Loads, TableMechanics, tips_of_pins
from tactibench_sim.drag import TipDrag, add_field, drag_of, share_pull
from tactibench_sim.kernels import Index


@dataclass(frozen=True, eq=False)
class Pull:
    """Tips of one radius that pull the skin sideways.

    Attributes:
        rows: (S,) rows of the scenes in the batch.
        table: Drag tables of the tip.
        n: (S, K, 3) directions in which the tips press.
        delta: (S, K) penetrations, mm.
        force: (S, K, 3) tangential forces on the skin, E_skin mm^2.
    """

    rows: Index
    table: TipDrag
    n: Array
    delta: Array
    force: Array

    def add(self, table: Array, directions: Array, u: Array, q: Array) -> None:
        """Add the response of one skin.

        Args:
            table: ``inner`` or ``outer`` of the drag tables.
            directions: (P, 3) unit vectors.
            u: (S, P, 3) displacement of the batch, mm, to which the response is added.
            q: (S, P, 3) turn of the normals, rad, likewise.
        """
        steps = self.table.depth_step, self.table.polar_step
        at = plain(directions)
        add_field(table, *steps, self.rows, self.n, self.delta, self.force, at, u, q)


@dataclass(frozen=True, eq=False)
class DraggedLoads:
    """Loads of presses and the pulls of those that move sideways.

    Attributes:
        pressed: Loads of the mechanics without friction.
        pulls: Pulls, one for each radius.
    """

    pressed: tuple[Loads, ...]
    pulls: tuple[Pull, ...]


class FrictionMechanics:
    """Mechanics of a press whose tips drag the skin as far as friction lets them."""

    def __init__(self, mechanics: TableMechanics, friction: float) -> None:
        """Take the mechanics without friction, and Coulomb's coefficient."""
        self.frictionless, self.friction = mechanics, friction
        self.tier, self.inner = mechanics.tier, mechanics.inner

    def loads(self, tips: Tips) -> DraggedLoads:
        """Solve for how the tips share the load and how far the skin follows them.

        Raises:
            UserError: The mechanics without friction cannot press one of the scenes, or a tip that
                moves has no tables of drag or is too deep for them.
        """
        pressed = self.frictionless.loads(tips)
        if tips.move is None:
            return DraggedLoads(pressed, ())
        n, delta = tips.directions()
        moving = (tips.move != 0).any(axis=(1, 2)) & (delta > 0).any(axis=1)
        if not moving.any():
            return DraggedLoads(pressed, ())
        rows_of = {
            float(radius): np.flatnonzero(moving & (tips.radius == radius))
            for radius in np.unique(tips.radius[moving])
        }
        pulls, behind = self._pull(tips, n, delta, self.frictionless.forces(pressed), rows_of)
        # Raised skin changes the forces that limit the pulls. Solving again for them would cost a
        # third more and take 0.02 to 0.04 mm off the error of moved pairs alone.
        return DraggedLoads(self.frictionless.loads(behind), pulls)

    def _pull(
        self, tips: Tips, n: Array, delta: Array, forces: Array, rows_of: Mapping[float, Index]
    ) -> tuple[tuple[Pull, ...], Tips]:
        """Return the pulls of tips under normal forces (S, K), and the tips as they press then."""
        assert tips.move is not None  # noqa: S101 - the caller has looked
        pulls, followed, raised = [], np.zeros_like(n), np.zeros_like(delta)
        for radius, rows in rows_of.items():
            table = drag_of(radius)
            at, depth = n[rows], delta[rows]
            if (depth > table.deepest + SLACK).any():
                raise UserError(
                    f"a tip of R = {radius:g} mm moves sideways {depth.max():.2f} mm deep; its "
                    f"tables of drag end at {table.deepest:g} mm: press less deep, or leave "
                    "sensor.friction out."
                )
            force, skin, up = share_pull(
                table.outer,
                table.depth_step,
                table.polar_step,
                at,
                depth,
                _tangential(tips.move[rows], at),
                self.friction * forces[rows],
                table.compliance_at(depth.clip(0.0)),
            )
            raised[rows] = np.minimum(up, (table.deepest - depth).clip(0.0))  # the tables end
            if math.isfinite(radius):  # a plate touches where its normal says, however it slides
                followed[rows] = np.where(depth[..., None] > 0, skin, 0.0)
            pulls.append((rows, table, force))
        behind = _behind(tips, n, delta, followed, raised)
        at, deep = behind.directions()
        return tuple(Pull(rows, table, at[rows], deep[rows], f) for rows, table, f in pulls), behind

    def displacement(self, loads: DraggedLoads, directions: Array) -> tuple[Array, Array]:
        """Return displacement of pin bases, mm, and turn of their normals, rad, each (S, P, 3)."""
        u, q = self.frictionless.displacement(loads.pressed, directions)
        for pull in loads.pulls:
            pull.add(pull.table.inner, directions, u, q)
        return u, q

    def pin_tips(self, loads: DraggedLoads, directions: Array, length: float) -> Array:
        """Return the (S, P, 3) tips of pins of ``length`` mm, from the dome's centre, mm."""
        return tips_of_pins(self.inner, directions, self.displacement(loads, directions), length)

    def skin(self, loads: DraggedLoads, directions: Array) -> Array:
        """Return the (S, P) inward displacement of the outer skin, mm."""
        inward = self.frictionless.skin(loads.pressed, directions)
        if loads.pulls:
            u = np.zeros((*inward.shape, 3))
            for pull in loads.pulls:
                pull.add(pull.table.outer, directions, u, np.zeros_like(u))
            inward -= (u * directions).sum(axis=-1)
        return inward

    def forces(self, loads: DraggedLoads) -> Array:
        """Return the (S, K) normal force of every tip, E_skin mm^2."""
        return self.frictionless.forces(loads.pressed)


def _tangential(move: Array, n: Array) -> Array:
    """Return the parts (S, K, 3) of horizontal moves (S, K, 2) along the dome's skin at n."""
    flat = np.concatenate([move, np.zeros((*move.shape[:-1], 1))], axis=-1)
    out: Array = flat - (flat * n).sum(axis=-1, keepdims=True) * n
    return out


def _behind(tips: Tips, n: Array, delta: Array, followed: Array, raised: Array) -> Tips:
    """Return tips in the directions of the points of the skin that they press.

    A point at the angle a from the tip's direction lies (R_d - delta) tan(a) beside its axis. Skin
    that other tips raised is pressed deeper by that.
    """
    moved = (followed != 0).any(axis=-1) | (raised != 0)  # all others stay exactly as they are
    sphere = np.isfinite(tips.radius)[:, None] & np.isfinite(tips.depth) & moved
    reach = DOME_RADIUS_MM + np.where(np.isfinite(tips.radius), tips.radius, 0.0)[:, None]
    delta = np.where(sphere, delta, 0.0)
    at = (DOME_RADIUS_MM - delta)[..., None] * n - followed
    at /= np.linalg.norm(at, axis=-1, keepdims=True)
    away = reach - delta - raised
    xy = at[..., :2] * away[..., None]
    touch = np.sqrt(np.maximum(reach**2 - (xy**2).sum(axis=-1), 0.0))
    depth = touch - at[..., 2] * away
    return Tips(
        np.where(sphere[..., None], xy, tips.xy), np.where(sphere, depth, tips.depth), tips.radius
    )
