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

The tabulated drag: a tip presses the apex and is pulled along the skin. For each unit of sideways
force the skin moves by a field that is proportional to cos(phi) inward (W) and away from the
contact (A) and to sin(phi) along the circles around it (V), with phi measured from the direction of
the pull. The file has these fields for some radii and depths, from three-dimensional finite
elements; between radii they are splines in log R at one share of the greatest depth. The skin under
the tip moves by the compliance times the force.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.compiled import jit, plain
from tactibench_sim.contact import SLACK, Tips
from tactibench_sim.dome import Loads, TableMechanics, tips_of_pins
from tactibench_sim.kernels import REACH_MM, Index
from tactibench_sim.tables import TableFile, between, deepest_of, shipped_file

Array = npt.NDArray[np.float64]
SHARES = (0.05, 0.125, 0.25, 0.375, 0.5, 0.65, 0.8, 1.0)
"""Depths of the runs, in shares of each tip's greatest. Below the first one its field is taken: the
friction that can pull a light contact is small, whatever the skin does for each unit of it."""
QUANTITIES = 5
DEPTH_NODES, POLAR_STEP_DEG = 65, 0.5
"""Fineness of the tables that are looked up linearly."""
STEPS = 4
_ROUNDS = 200
_SETTLED = 1e-9
"""Change of a sideways force, E_skin mm^2, at which the forces of several tips are settled."""
_AT_TIP, _TINY = 1e-9, 1e-300
_TO_SLIP = 1.5
"""Mindlin: a round contact slips as a whole after 1.5 times the way that its first stiffness
says."""


@dataclass(frozen=True, eq=False)
class TipDrag:
    """The response of both skins to a unit of sideways force of one tip, E_skin mm^2.

    Depths and polar angles are uniform, from 0.

    Attributes:
        inner: (D, T, 5) W, A, V of the inner skin, mm, and two turns of its normal, rad.
        outer: (D, T, 5) likewise of the outer skin, whose turns are 0.
        compliance: (D,) ways of the skin under the tip, mm.
        depth_step: Step of the depths, mm.
        polar_step: Step of the polar angles, rad.
    """

    inner: Array
    outer: Array
    compliance: Array
    depth_step: float
    polar_step: float

    @property
    def deepest(self) -> float:
        """Greatest tabulated penetration, mm."""
        return self.depth_step * (len(self.compliance) - 1)

    def compliance_at(self, depth: Array) -> Array:
        """Return how far a unit of force moves the skin under the tip, mm, at depths, mm."""
        nodes = self.depth_step * np.arange(len(self.compliance))
        return np.asarray(np.interp(depth, nodes, self.compliance), dtype=np.float64)


@cache
def tip_drag(radius: float) -> TipDrag:
    """Return the tables of a tip.

    drag.npz holds (K,) ``radii``, mm, the last one of a plate; (K,) greatest depths ``deepest``,
    mm; ``field`` (K, D, 2, 3, T), W, A, V of the inner and the outer skin at SHARES of the depth;
    ``compliance`` (K, D), ways of the skin under the tip, mm.

    Args:
        radius: Radius, mm; inf for a plate.

    Raises:
        UserError: The radius lies outside of those of the file.
    """
    file = shipped_file("drag.npz")
    radii, ends = file.arrays["radii"], file.arrays["deepest"]
    fields, compliances = file.arrays["field"], file.arrays["compliance"]
    if radius in radii:
        k = int(np.flatnonzero(radii == radius)[0])
        return _fine(float(ends[k]), fields[k], compliances[k], file)
    spheres = np.flatnonzero(np.isfinite(radii))
    low, high = radii[spheres[0]], radii[spheres[-1]]
    if not low <= radius <= high:
        raise UserError(
            f"a tip of R = {radius:g} mm rubs; the simulator has tables of drag for "
            f"{low:g} to {high:g} mm. Take such a tip, or sensor.friction=0."
        )

    def at_radius(values: Array) -> Array:
        """Return values (K, D, ...) at the shares of the tip's greatest depth."""
        at_share = []
        for k in spheres.tolist():
            nodes, wanted = ends[k] * np.array(SHARES), deepest_of(radii[k]) * np.array(SHARES)
            at_share.append(CubicSpline(nodes, values[k])(wanted.clip(nodes[0])))
        return between(radii[spheres], np.stack(at_share), radius)

    return _fine(deepest_of(radius), at_radius(fields), at_radius(compliances), file)


def _fine(end: float, field: Array, compliance: Array, file: TableFile) -> TipDrag:
    """Return tables fine enough for linear look-ups, down to ``end`` mm."""
    shares = np.array(SHARES)
    depth = np.linspace(0.0, end, DEPTH_NODES)
    at = depth.clip(end * shares[0])
    coarse = np.radians(file.parameters["polar_step_deg"]) * np.arange(field.shape[-1])
    polar = np.radians(POLAR_STEP_DEG) * np.arange(round(90 / POLAR_STEP_DEG) + 1)
    along = CubicSpline(coarse, CubicSpline(end * shares, field)(at), axis=-1)
    skins = np.moveaxis(along(polar), -1, 2)  # (D, 2, T, 3)
    inner = _with_turns(skins[:, 0], along(polar, 1)[:, 0, 0], polar, file.parameters["dome"])
    outer = np.concatenate([skins[:, 1], np.zeros((*skins.shape[:1], len(polar), 2))], axis=-1)
    softness = CubicSpline(end * shares, compliance)(at)
    return TipDrag(inner, np.ascontiguousarray(outer), softness, float(depth[1]), float(polar[1]))


def _with_turns(skin: Array, slope: Array, polar: Array, dome: Mapping[str, float]) -> Array:
    """Return (D, T, 5): W, A, V and the turns (W' + A) / r and (V - W / sin) / r."""
    w, a, v = np.moveaxis(skin, -1, 0)
    radius = float(dome["outer"] - dome["skin"])
    ratio = np.divide(w, np.sin(polar), out=np.zeros_like(w), where=polar > 0)
    ratio[:, 0] = slope[:, 0]
    turns = (slope + a) / radius, (v - ratio) / radius
    return np.ascontiguousarray(np.stack([w, a, v, *turns], axis=-1))


@jit
def _respond(  # type: ignore[no-untyped-def]
    table, depth_step, polar_step, n, delta, px, py, pz, b
):
    """Return u (3) and the turn (3) in the direction b of a pull (px, py, pz) at n.

    At b = cos n + sin h the frame is b, e = cos h - sin n away from n, and f = n x h around it. The
    look-up is linear in depth and angle.
    """
    cosine = min(1.0, max(-1.0, n[0] * b[0] + n[1] * b[1] + n[2] * b[2]))
    sine = math.sqrt(1.0 - cosine * cosine)
    at, up = math.acos(cosine) / polar_step, max(delta, 0.0) / depth_step
    left, low = int(at), min(int(up), table.shape[0] - 2)
    if left >= table.shape[1] - 1:  # beyond the clamped rim
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y = at - left, min(up - low, 1.0)
    if sine > _AT_TIP:
        hx = (b[0] - cosine * n[0]) / sine
        hy = (b[1] - cosine * n[1]) / sine
        hz = (b[2] - cosine * n[2]) / sine
    else:  # any direction is right; that of the pull leaves the terms with cos alone
        size = math.sqrt(px * px + py * py + pz * pz) + _TINY
        hx, hy, hz = px / size, py / size, pz / size
    fx, fy, fz = n[1] * hz - n[2] * hy, n[2] * hx - n[0] * hz, n[0] * hy - n[1] * hx
    along, across = px * hx + py * hy + pz * hz, -(px * fx + py * fy + pz * fz)
    a, c = (1.0 - y) * (1.0 - x), (1.0 - y) * x
    d, g = y * (1.0 - x), y * x
    node, beside = table[low, left], table[low, left + 1]
    deeper, deeper_beside = table[low + 1, left], table[low + 1, left + 1]
    w = along * (a * node[0] + c * beside[0] + d * deeper[0] + g * deeper_beside[0])
    t = along * (a * node[1] + c * beside[1] + d * deeper[1] + g * deeper_beside[1])
    v = across * (a * node[2] + c * beside[2] + d * deeper[2] + g * deeper_beside[2])
    turn_e = along * (a * node[3] + c * beside[3] + d * deeper[3] + g * deeper_beside[3])
    turn_f = across * (a * node[4] + c * beside[4] + d * deeper[4] + g * deeper_beside[4])
    ex, ey, ez = cosine * hx - sine * n[0], cosine * hy - sine * n[1], cosine * hz - sine * n[2]
    return (
        t * ex - w * b[0] + v * fx,
        t * ey - w * b[1] + v * fy,
        t * ez - w * b[2] + v * fz,
        turn_e * ex + turn_f * fx,
        turn_e * ey + turn_f * fy,
        turn_e * ez + turn_f * fz,
    )


@jit
def add_field(  # type: ignore[no-untyped-def]
    table, depth_step, polar_step, rows, n, delta, pull, directions, u, q
):
    """Add the pulls of some rows of a batch to u and q.

    Args:
        table: (D, T, 5) response of one skin (``TipDrag``).
        depth_step: Step of the depths, mm.
        polar_step: Step of the polar angles, rad.
        rows: (R,) rows of the batch.
        n: (R, K, 3) directions of the tips.
        delta: (R, K) penetrations, mm.
        pull: (R, K, 3) forces, E_skin mm^2.
        directions: (P, 3) unit vectors.
        u: (S, P, 3) displacement, mm, to which the pulls are added.
        q: (S, P, 3) turn of the normals, rad, likewise.
    """
    for r in range(len(n)):
        for i in range(n.shape[1]):
            x, y, z = pull[r, i, 0], pull[r, i, 1], pull[r, i, 2]
            if x == 0.0 and y == 0.0 and z == 0.0:
                continue
            for p in range(len(directions)):
                a, b, c, d, e, f = _respond(
                    table, depth_step, polar_step, n[r, i], delta[r, i], x, y, z, directions[p]
                )
                u[rows[r], p, 0] += a
                u[rows[r], p, 1] += b
                u[rows[r], p, 2] += c
                q[rows[r], p, 0] += d
                q[rows[r], p, 1] += e
                q[rows[r], p, 2] += f


@jit
def share_pull(  # type: ignore[no-untyped-def]
    table, depth_step, polar_step, n, delta, wish, limit, compliance
):
    """Return the sideways forces of tips and the ways by which the skin under them moves.

    By Gauss-Seidel: each tip in turn takes the force that belongs to the part of its move which the
    others leave. The law of one tip is the slope of a convex energy, so the rounds converge.

    Args:
        table: (D, T, 5) response of the outer skin (``TipDrag``).
        depth_step: Step of the depths, mm.
        polar_step: Step of the polar angles, rad.
        n: (S, K, 3) directions of the tips.
        delta: (S, K) penetrations, mm.
        wish: (S, K, 3) tangential moves of the tips, mm.
        limit: (S, K) greatest forces, E_skin mm^2.
        compliance: (S, K) way of the skin per unit of force, mm.

    Returns:
        (S, K, 3) forces, E_skin mm^2; (S, K, 3) ways by which the skin follows, mm; and (S, K) how
        far other tips raise the skin under each tip, mm.
    """
    force, followed, raised = np.zeros_like(wish), np.zeros_like(wish), np.zeros_like(limit)
    count = n.shape[1]
    between = np.zeros((count, count, 3, 3))  # [i, j] takes the force of j to the skin under i
    moved, axes = np.empty(3), np.eye(3)
    for s in range(len(n)):
        for i in range(count):
            for j in range(count):
                if i != j and delta[s, i] > -REACH_MM and limit[s, j] > 0.0:
                    for k in range(3):
                        x, y, z, _, _, _ = _respond(
                            table,
                            depth_step,
                            polar_step,
                            n[s, j],
                            delta[s, j],
                            axes[k, 0],
                            axes[k, 1],
                            axes[k, 2],
                            n[s, i],
                        )
                        between[i, j, 0, k], between[i, j, 1, k], between[i, j, 2, k] = x, y, z
        for _ in range(_ROUNDS):
            change = 0.0
            for i in range(count):
                if delta[s, i] <= -REACH_MM:
                    continue
                up = 0.0
                for k in range(3):
                    moved[k] = 0.0
                    for j in range(count):
                        if j != i and limit[s, j] > 0.0:
                            for m in range(3):
                                moved[k] += between[i, j, k, m] * force[s, j, m]
                    up += moved[k] * n[s, i, k]
                raised[s, i] = up
                if limit[s, i] <= 0.0:
                    continue
                square = 0.0
                for k in range(3):
                    moved[k] -= up * n[s, i, k]
                    square += (wish[s, i, k] - moved[k]) ** 2
                way = math.sqrt(square)
                slip = min(way / (_TO_SLIP * limit[s, i] * compliance[s, i]), 1.0)
                size = limit[s, i] * (1.0 - (1.0 - slip) ** _TO_SLIP) / (way + _TINY)
                for k in range(3):
                    new = size * (wish[s, i, k] - moved[k])
                    change = max(change, abs(new - force[s, i, k]))
                    force[s, i, k] = new
                    followed[s, i, k] = moved[k] + compliance[s, i] * new
            if change < _SETTLED or count == 1:
                break
    return force, followed, raised


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
            UserError: The mechanics without friction cannot press one of the scenes, or a tip has
                no tables of drag or is too deep for them.
        """
        n, delta = tips.directions()
        rubbing = (delta > 0).any(axis=1)
        pulls, followed, raised = [], np.zeros_like(n), np.zeros_like(delta)
        for radius in np.unique(tips.radius[rubbing]).tolist():
            rows = np.flatnonzero(rubbing & (tips.radius == radius))
            table = tip_drag(radius)
            depth = delta[rows]
            if (depth > table.deepest + SLACK).any():
                raise UserError(
                    f"a tip of R = {radius:g} mm rubs {depth.max():.2f} mm deep; its drag tables "
                    f"end at {table.deepest:g} mm: press less deep, or take sensor.friction=0."
                )
            force, skin, up = self._rub(tips.take(rows), table)
            raised[rows] = np.minimum(up, (table.deepest - depth).clip(0.0))  # the tables end
            if math.isfinite(radius):  # a plate touches where its normal says, however it slides
                followed[rows] = np.where(depth[..., None] > 0, skin, 0.0)
            pulls.append((rows, table, force))
        behind = _behind(tips, n, delta, followed, raised)
        at, deep = behind.directions()
        return DraggedLoads(
            self.frictionless.loads(behind),
            tuple(Pull(rows, table, at[rows], deep[rows], force) for rows, table, force in pulls),
        )

    def _rub(self, tips: Tips, table: TipDrag) -> tuple[Array, Array, Array]:
        """Return forces, ways of the skin and its rise of tips of one radius, as ``share_pull``."""
        force = followed = others = aside = None
        friction = self.friction if tips.friction is None else tips.friction[:, None]
        for step, travel, part in steps_of(tips):
            n, delta = step.directions()
            loads = self.frictionless.loads(step)
            limit = friction * self.frictionless.forces(loads)
            soft = table.compliance_at(delta.clip(0.0))
            pushed = self.frictionless.push_aside(loads)
            way = _along(travel, n)
            if force is not None:
                way += _along(_way_to(force, limit, soft) + others - part * (pushed - aside), n)
            else:
                way -= part * pushed
            force, followed, raised = share_pull(
                table.outer, table.depth_step, table.polar_step, n, delta, way, limit, soft
            )
            others, aside = followed - soft[..., None] * force, pushed
        return force, followed, raised

    def displacement(self, loads: DraggedLoads, directions: Array) -> tuple[Array, Array]:
        """Return displacement of pin bases, mm, and turn of their normals, rad, each (S, P, 3)."""
        u, q = self.frictionless.displacement(loads.pressed, directions)
        for pull in loads.pulls:
            pull.add(pull.table.inner, directions, u, q)
        return u, q

    def pin_tips(self, loads: DraggedLoads, directions: Array, length: float) -> Array:
        """Return the (S, P, 3) tips of pins of ``length`` mm, from the dome's centre, mm."""
        return tips_of_pins(self.inner, directions, self.displacement(loads, directions), length)

    def outer(self, loads: DraggedLoads, directions: Array) -> Array:
        """Return the (S, P, 3) displacement of the outer skin, mm."""
        u = plain(self.frictionless.outer(loads.pressed, directions))
        for pull in loads.pulls:
            pull.add(pull.table.outer, directions, u, np.zeros_like(u))
        return u

    def skin(self, loads: DraggedLoads, directions: Array) -> Array:
        """Return the (S, P) inward displacement of the outer skin, mm."""
        inward: Array = -(self.outer(loads, directions) * directions).sum(axis=-1)
        return inward

    def forces(self, loads: DraggedLoads) -> Array:
        """Return the (S, K) normal force of every tip, E_skin mm^2."""
        return self.frictionless.forces(loads.pressed)

    def contact_forces(self, loads: DraggedLoads) -> Array:
        """Return the (S, K, 3) forces of the tips on the skin, E_skin mm^2."""
        forces = self.frictionless.contact_forces(loads.pressed)
        for pull in loads.pulls:
            forces[pull.rows] += pull.force
        return forces


def steps_of(tips: Tips) -> Iterator[tuple[Tips, Array, Array]]:
    """Yield the tips step by step on the way to where they are: down, then sideways.

    Yields:
        The tips; (S, K, 3) ways of each tip since the step before and its first touch, mm; and
        (S, K, 1) the part of the step in which it touched.
    """
    plate = np.isinf(tips.radius)[:, None]
    depth = tips.depth if tips.move is None else _depth_before(tips)
    xy = tips.xy if tips.move is None else tips.xy - np.where(plate[..., None], 0.0, tips.move)
    deepest = depth.max(axis=1, keepdims=True).clip(0.0)
    before = np.zeros_like(depth)
    for number in range(1, STEPS + 1):
        step = Tips(xy, depth - deepest * (1 - number / STEPS), tips.radius)
        down = step.depth.clip(0.0) - before
        before = step.depth.clip(0.0)
        part = np.divide(STEPS * down, deepest, out=np.zeros_like(down), where=deepest > 0)
        upright = np.where(plate, step.directions()[0][..., 2], 1.0)  # a plate's depth is normal
        travel = np.zeros((*down.shape, 3))
        travel[..., 2] = -down / upright
        yield step, travel, part[..., None]
    if tips.move is not None:
        travel = np.concatenate([tips.move, np.zeros((*tips.move.shape[:-1], 1))], axis=-1)
        yield Tips(tips.xy, tips.depth, tips.radius), travel, np.ones((*depth.shape, 1))


def _depth_before(tips: Tips) -> Array:
    """Return the (S, K) depths before the tips moved sideways, at one height."""
    reach = DOME_RADIUS_MM + np.where(np.isfinite(tips.radius), tips.radius, 0.0)[:, None]
    now, then = (
        np.sqrt(np.maximum(reach**2 - (xy**2).sum(axis=-1), 0.0))
        for xy in (tips.xy, tips.xy - tips.move)
    )
    return np.where(np.isfinite(tips.radius)[:, None], tips.depth + then - now, tips.depth)


def _along(ways: Array, n: Array) -> Array:
    """Return the parts (S, K, 3) of ways along the dome's skin at n."""
    out: Array = ways - (ways * n).sum(axis=-1, keepdims=True) * n
    return out


def _way_to(force: Array, limit: Array, compliance: Array) -> Array:
    """Return the ways (S, K, 3), mm, after which tips that slide from rest have these forces."""
    size = np.linalg.norm(force, axis=-1)
    used = np.divide(size, limit, out=np.zeros_like(size), where=limit > 0).clip(0.0, 1.0)
    way = _TO_SLIP * limit * compliance * (1.0 - (1.0 - used) ** (1 / _TO_SLIP))
    return force * np.divide(way, size, out=np.zeros_like(size), where=size > 0)[..., None]


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
