"""Tips that stick to the skin and slip: what friction adds to the field of a press.

A tip that goes down by d at the angle b from the apex slides over the skin by d sin(b), less what
the normal loads of other tips move the skin under it. The skin follows until the tip slips. The
press is solved in a few steps of depth. In each of them the sideways force Q of a tip is, along the
slip x of the step,

    Q = mu F x / sqrt(x^2 + e^2),      x = m - C Q,

with F the normal force, m the way over the skin since the step before and what the skin followed
until then, C the compliance of the skin under the tip, and e the way by which the skin under the
contact spreads to all sides meanwhile: where friction acts to all sides, little of it is left for
one. So tips that press together, whose slide their neighbours' loads take away, nearly stick.

After that a pose may go sideways by m, and nothing spreads. The force is then Mindlin's for a round
contact (Compliance of elastic bodies in contact, J. Appl. Mech. 16, 1949), which begins as m / C
and ends at Coulomb's limit,

    Q(m) = mu F (1 - (1 - min(|m| / (1.5 mu F C), 1))^1.5)    along m.

It goes on from the way after which it would have the force that the press left. Where other tips
pull the skin along, m is the rest of the way, so the forces are solved for together. The way that
the skin followed, s = C Q + sum over other tips, is a part of the way on which the tip did not
slide: a spherical tip presses the point of the skin that lies s before the place where it ends. It
presses deeper where other tips raise the skin. The field is that of the press there plus Q times
the tabulated drag. Left out are the twist of a tip about its own axis, and what the clamped rim
changes in the drag beyond HELD. A plate goes down along its normal and slides no way.

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
from tactibench_sim.kernels import FADE_RAD, REACH_MM, Index, hermite
from tactibench_sim.tables import TableFile, between, deepest_of, shipped_file

Array = npt.NDArray[np.float64]
SHARES = (0.05, 0.125, 0.25, 0.375, 0.5, 0.65, 0.8, 1.0)
"""Depths of the runs, in shares of each tip's greatest. Below the first one its field is taken: the
friction that can pull a light contact is small, whatever the skin does for each unit of it."""
QUANTITIES = 5
DEPTH_NODES, POLAR_STEP_DEG = 65, 0.5
"""Fineness of the tables that are looked up linearly."""
HELD = 0.33
"""mm per E_skin mm^2: how far a pull along the axis would move the whole dome by the tables, and
does not. A dome sways to a side but hardly shortens: the tables are of a pull to the side at the
apex. Finite elements of tips 10 to 25 deg beside it show this difference, to 20 %, at all pins that
are more than 15 deg from the tip."""
_NEAR = 0.025  # 1 - cos of the angle, 13 deg, at which half of it is left
STIFFER = 0.07
"""Share by which friction of 1 adds to the normal force. By finite elements a friction of .3 adds 2
to 3 % and one of .5 adds 2 to 5 %, 1 to 4 mm deep, to single tips and to pairs alike."""
STEPS = 2
"""Steps of depth of a press. With 8 the frames of pairs and triples 1 to 4 mm deep come no nearer
to finite elements."""
SPREAD = 0.08
"""Way of the skin under a contact to all sides, per way of the tip down. Fitted to the pull of 12
scenes of finite elements, which is 15 to 48 % of the normal force at a friction of 0.5."""
_ROUNDS = 200
_NEWTON = 50  # four to eight are enough
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
def _meridian(table, depth_step, delta, out):  # type: ignore[no-untyped-def]
    """Fill out (T, 5) with the response at a penetration, linear between the depths."""
    up = max(delta, 0.0) / depth_step
    low = min(int(up), table.shape[0] - 2)
    y = min(up - low, 1.0)
    for t in range(table.shape[1]):
        for k in range(QUANTITIES):
            out[t, k] = (1.0 - y) * table[low, t, k] + y * table[low + 1, t, k]


@jit
def _respond(meridian, polar_step, n, px, py, pz, b):  # type: ignore[no-untyped-def]
    """Return u (3) and the turn (3) in the direction b of a pull p = (px, py, pz) at n.

    At b = cos n + sin h the frame is b, e = cos h - sin n away from n, and f = n x h around it. The
    part of the pull along f is r = p - (p h) h - (p n) n, and with -f for its own direction

        u = (p h) (A e - W b) - V r.

    The look-up is linear in the angle.
    """
    cosine = min(1.0, max(-1.0, n[0] * b[0] + n[1] * b[1] + n[2] * b[2]))
    sine = math.sqrt(1.0 - cosine * cosine)
    at, last = math.acos(cosine) / polar_step, meridian.shape[0] - 1
    left = min(int(at), last - 1)
    if at > last:  # beyond the clamped rim, as the field of a press
        kept, _, _, _ = hermite(min((at - last) * polar_step / FADE_RAD, 1.0), FADE_RAD)
        px, py, pz, at = kept * px, kept * py, kept * pz, float(last)
    if sine > _AT_TIP:
        hx = (b[0] - cosine * n[0]) / sine
        hy = (b[1] - cosine * n[1]) / sine
        hz = (b[2] - cosine * n[2]) / sine
    else:  # any direction is right; that of the pull leaves the terms with cos alone
        size = math.sqrt(px * px + py * py + pz * pz) + _TINY
        hx, hy, hz = px / size, py / size, pz / size
    ph, pn = px * hx + py * hy + pz * hz, px * n[0] + py * n[1] + pz * n[2]
    rx, ry, rz = px - ph * hx - pn * n[0], py - ph * hy - pn * n[1], pz - ph * hz - pn * n[2]
    c = at - left
    a = 1.0 - c
    w = ph * (a * meridian[left, 0] + c * meridian[left + 1, 0])
    t = ph * (a * meridian[left, 1] + c * meridian[left + 1, 1])
    v = a * meridian[left, 2] + c * meridian[left + 1, 2]
    turn_e = ph * (a * meridian[left, 3] + c * meridian[left + 1, 3])
    turn_f = a * meridian[left, 4] + c * meridian[left + 1, 4]
    ex, ey, ez = cosine * hx - sine * n[0], cosine * hy - sine * n[1], cosine * hz - sine * n[2]
    return (
        t * ex - w * b[0] - v * rx,
        t * ey - w * b[1] - v * ry,
        t * ez - w * b[2] - v * rz,
        turn_e * ex - turn_f * rx,
        turn_e * ey - turn_f * ry,
        turn_e * ez - turn_f * rz,
    )


@jit
def _held_at(cosine: float, height: float) -> float:
    """Return the share, 0 to 1, of HELD at a pin.

    It is 0 at the tip, which carries the skin along whatever the dome does, and at the rim.

    Args:
        cosine: Cosine of the angle from the tip to the pin.
        height: Cosine of the pin's polar angle.
    """
    away = ((1.0 - cosine) / _NEAR) ** 2
    low = (1.0 - max(height, 0.0)) ** 6
    return away / (1.0 + away) * (1.0 - low)


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
    meridian = np.empty(table.shape[1:])
    for r in range(len(n)):
        for i in range(n.shape[1]):
            x, y, z = pull[r, i, 0], pull[r, i, 1], pull[r, i, 2]
            if x == 0.0 and y == 0.0 and z == 0.0:
                continue
            _meridian(table, depth_step, delta[r, i], meridian)
            for p in range(len(directions)):
                way = directions[p]
                a, b, c, d, e, f = _respond(meridian, polar_step, n[r, i], x, y, z, way)
                cosine = n[r, i, 0] * way[0] + n[r, i, 1] * way[1] + n[r, i, 2] * way[2]
                u[rows[r], p, 0] += a
                u[rows[r], p, 1] += b
                u[rows[r], p, 2] += c - HELD * z * _held_at(cosine, way[2])
                q[rows[r], p, 0] += d
                q[rows[r], p, 1] += e
                q[rows[r], p, 2] += f


@jit
def pull_of(way: float, limit: float, compliance: float, spread: float) -> float:
    """Return the sideways force of one tip after a way that the skin under it did not go.

    Args:
        way: The way, mm.
        limit: Coulomb's limit, E_skin mm^2.
        compliance: Way of the skin per unit of force, mm.
        spread: Way of the skin under the contact to all sides meanwhile, mm.
    """
    if spread == 0.0:
        slip = min(way / (_TO_SLIP * limit * compliance), 1.0)
        whole: float = limit * (1.0 - (1.0 - slip) ** _TO_SLIP)
        return whole
    # The slip x is where x + C L x / sqrt(x^2 + e^2) = m. The left side is concave, so Newton's
    # method rises to the solution from 0.
    x = 0.0
    for _ in range(_NEWTON):
        size = math.sqrt(x * x + spread * spread)
        left = x + compliance * limit * x / size - way
        step = left / (1.0 + compliance * limit * spread * spread / (size * size * size))
        x -= step
        if abs(step) < _SETTLED:
            break
    return (way - x) / compliance


@jit
def share_pull(  # type: ignore[no-untyped-def]
    table, depth_step, polar_step, n, delta, wish, limit, compliance, spread
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
        spread: (S, K) ways of the skin under each contact to all sides, mm.

    Returns:
        (S, K, 3) forces, E_skin mm^2; (S, K, 3) ways by which the skin follows, mm; and (S, K) how
        far other tips raise the skin under each tip, mm.
    """
    force, followed, raised = np.zeros_like(wish), np.zeros_like(wish), np.zeros_like(limit)
    count = n.shape[1]
    between = np.zeros((count, count, 3, 3))  # [i, j] takes the force of j to the skin under i
    moved, axes, meridian = np.empty(3), np.eye(3), np.empty(table.shape[1:])
    for s in range(len(n)):
        for j in range(count if count > 1 else 0):
            if limit[s, j] <= 0.0:
                continue
            _meridian(table, depth_step, delta[s, j], meridian)
            for i in range(count):
                if i == j or delta[s, i] <= -REACH_MM:
                    continue
                for k in range(3):
                    x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
                    x, y, z, _, _, _ = _respond(meridian, polar_step, n[s, j], x, y, z, n[s, i])
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
                square = 0.0
                for k in range(3):
                    moved[k] -= up * n[s, i, k]
                    followed[s, i, k] = moved[k]  # a tip without load slides
                    square += (wish[s, i, k] - moved[k]) ** 2
                if limit[s, i] <= 0.0:
                    continue
                way = math.sqrt(square)
                size = pull_of(way, limit[s, i], compliance[s, i], spread[s, i]) / (way + _TINY)
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
        normal: (S, K, 3) normal forces on the skin, E_skin mm^2.
    """

    pressed: tuple[Loads, ...]
    pulls: tuple[Pull, ...]
    normal: Array


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
        pulls, raised, normal = [], np.zeros_like(delta), np.zeros_like(delta)
        followed = np.zeros_like(n)
        for radius in np.unique(tips.radius[rubbing]).tolist():
            rows = np.flatnonzero(rubbing & (tips.radius == radius))
            table = tip_drag(radius)
            depth = delta[rows]
            if (depth > table.deepest + SLACK).any():
                raise UserError(
                    f"a tip of R = {radius:g} mm rubs {depth.max():.2f} mm deep; its drag tables "
                    f"end at {table.deepest:g} mm: press less deep, or take sensor.friction=0."
                )
            force, skin, up, normal[rows] = self._rub(tips.take(rows), table)
            raised[rows] = np.minimum(up, (table.deepest - depth).clip(0.0))  # the tables end
            if math.isfinite(radius):  # a plate touches where its normal says, however it slides
                followed[rows] = skin
            pulls.append((rows, table, force))
        behind = _behind(tips, n, delta, followed, raised)
        at, deep = behind.directions()
        return DraggedLoads(
            self.frictionless.loads(behind),
            tuple(Pull(rows, table, at[rows], deep[rows], force) for rows, table, force in pulls),
            -normal[..., None] * n,
        )

    def _rub(self, tips: Tips, table: TipDrag) -> tuple[Array, Array, Array, Array]:
        """Return what ``share_pull`` returns for tips of one radius, and their normal forces."""
        friction = self.friction if tips.friction is None else tips.friction[:, None]
        force, followed = np.zeros((2, *tips.depth.shape, 3))
        raised, aside = np.zeros_like(tips.depth), np.zeros_like(force)
        for step, travel, down in steps_of(tips):
            n, delta = step.directions()
            loads = self.frictionless.loads(step)
            normal = self.frictionless.forces(loads) * (1 + STIFFER * np.minimum(friction, 1.0))
            limit = friction * normal
            soft = table.compliance_at(delta.clip(0.0))
            pushed = self.frictionless.push_aside(loads)
            way = travel + followed - (pushed - aside)
            if down is None:
                way += _way_to(force, limit, soft) - soft[..., None] * force
            spread = np.zeros_like(delta) if down is None else SPREAD * down
            new = share_pull(
                table.outer,
                table.depth_step,
                table.polar_step,
                n,
                delta,
                _along(way, n),
                limit,
                soft,
                spread,
            )
            if down is None and tips.move is not None:  # all others stay exactly as they are
                moved = (tips.move != 0).any(axis=(1, 2), keepdims=True)[..., 0]
                new = (
                    np.where(moved[..., None], new[0], force),
                    np.where(moved[..., None], new[1], followed),
                    np.where(moved, new[2], raised),
                )
            force, followed, raised = new
            aside = pushed
        return force, followed, raised, normal

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
        return np.asarray(np.linalg.norm(loads.normal, axis=-1))

    def contact_forces(self, loads: DraggedLoads) -> Array:
        """Return the (S, K, 3) forces of the tips on the skin, E_skin mm^2."""
        forces = loads.normal.copy()
        for pull in loads.pulls:
            forces[pull.rows] += pull.force
        return forces


def steps_of(tips: Tips) -> Iterator[tuple[Tips, Array, Array | None]]:
    """Yield the tips step by step on the way to where they are: down, then sideways.

    Yields:
        The tips; (S, K, 3) ways of each tip since the step before and its first touch, mm; and the
        (S, K) parts of them that led down, or None where they led sideways.
    """
    plate = np.isinf(tips.radius)[:, None]
    depth = tips.depth if tips.move is None else _depth_before(tips, tips.move)
    xy = tips.xy if tips.move is None else tips.xy - np.where(plate[..., None], 0.0, tips.move)
    deepest = depth.max(axis=1, keepdims=True).clip(0.0)
    before = np.zeros_like(depth)
    for number in range(1, STEPS + 1):
        step = Tips(xy, depth - deepest * (1 - number / STEPS), tips.radius)
        down = step.depth.clip(0.0) - before
        before = step.depth.clip(0.0)
        travel = np.zeros((*down.shape, 3))
        travel[..., 2] = np.where(plate, 0.0, -down)  # a plate goes down along its normal
        yield step, travel, down
    if tips.move is not None:
        travel = np.concatenate([tips.move, np.zeros((*tips.move.shape[:-1], 1))], axis=-1)
        yield Tips(tips.xy, tips.depth, tips.radius), travel, None


def _depth_before(tips: Tips, move: Array) -> Array:
    """Return the (S, K) depths before the tips moved sideways, at one height."""
    reach = DOME_RADIUS_MM + np.where(np.isfinite(tips.radius), tips.radius, 0.0)[:, None]
    now, then = (
        np.sqrt(np.maximum(reach**2 - (xy**2).sum(axis=-1), 0.0))
        for xy in (tips.xy, tips.xy - move)
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
    share = np.divide(way, size, out=np.zeros_like(size), where=size > 0)
    return np.asarray(force * share[..., None])


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
