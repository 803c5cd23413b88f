"""The dome's mechanics: the compiled loops over scenes, contacts and pins.

The displacement field of a press is

    u(b) = sum_i a_i [ T(angle(b, n_i); s_i) + O(b; s_i, beta_i) ]
         + sum_{i<j} C(b; angle(n_i, n_j), delta_i, delta_j)

T is the axisymmetric field of a contact at the apex, O what the clamped rim changes for a contact
at the polar angle beta, C what two contacts do beyond sharing their load. The turn q of the inner
surface's normal is summed alike. O and C are *patches* (see ``corrections``), a_i and s_i the
loads (see ``dome``).
"""

# All compiled functions of the dome stand in this one file: numba's cache on disk follows changes
# of the file of the function that is called, and would keep what it took from another file.

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactibench_sim.compiled import jit

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
Six = tuple[float, float, float, float, float, float]

REACH_MM = 1.0
"""Tips up to this far above the skin may be met by a bulge, which is never that high."""
POWER = 1.5
"""Exponent with which a pair's correction fades with its loads; fitted to two runs of triples 8 mm
apart."""
FADE_RAD = math.radians(20.0)
"""Angle beyond the rim over which the turn of a normal ends. A pin at the far rim stands about so
far beyond a quarter turn from a contact 20 deg off the apex; finite elements show a turn there that
falls steadily."""
_ROUNDS = 60  # two or three are enough, unless a bulge lifts a tip
_SHALLOW = 1e-6  # depth, mm, whose shape is taken for a tip that does not press yet
_REGULAR = 1e-10  # splits the load of exactly coincident tips evenly
_STRETCH = 512  # numbers that are summed up while they stay in the fastest cache
_LIGHT = 0.05  # amplitude below which the pairs of a light contact fade out
_APART = 0.05  # rad (1 mm): contacts nearer than this begin to count as one
_APEX = 1e-9  # sine of an angle below which "down the side" or "to the other" has no direction


class Meridians(NamedTuple):
    """Axisymmetric fields of M indenters, on D uniform depths from 0 and T uniform angles from 0.

    Attributes:
        value: (M, D, T, 2 Q) quantities, each with its slope in the angle.
        rate: (M, D, T, 2 Q) their derivatives by depth.
        depth_step: Step of the depths, mm.
        polar_step: Step of the angles, rad.
    """

    value: Array
    rate: Array
    depth_step: float
    polar_step: float


class Modes(NamedTuple):
    """R modes of a patch.

    Attributes:
        grid: (R, A + 2, B + 2, C) spline coefficients at a = start, start + step, ... and
            b = 0, step, ... Those at b < 0 are the mirror image. C is 6: displacement, mm, and turn
            of the normal, rad, each along e, f, m.
        step: Step of the grid, chords.
        start: First a of the grid, chords.
    """

    grid: Array
    step: float
    start: float


class Around(NamedTuple):
    """O of every indenter.

    Attributes:
        modes: The modes of the patches.
        amounts: (M, B + 2, D + 2, R) spline coefficients of the modes' amounts over beta and depth.
        beta_step: Step of beta, rad.
        depth_step: Step of the depth, mm.
    """

    modes: Modes
    amounts: Array
    beta_step: float
    depth_step: float


class Pairs(NamedTuple):
    """C of one indenter.

    Attributes:
        modes: The modes of the patches.
        amounts: (A + 2, D + 2, D + 2, R) spline coefficients of the modes' amounts over the angle
            between two contacts and both penetrations.
        angle_step: Step of the angle, rad.
        depth_step: Step of the penetrations, mm.
        indenter: Index of the indenter; -1: there is none.
    """

    modes: Modes
    amounts: Array
    angle_step: float
    depth_step: float
    indenter: int


@jit
def hermite(fraction: float, step: float) -> tuple[float, float, float, float]:
    """Return the weights of (value, slope) at the left and (value, slope) at the right node."""
    f, g = fraction, 1.0 - fraction
    return g * g * (1.0 + 2.0 * f), step * f * g * g, f * f * (3.0 - 2.0 * f), -step * f * f * g


@jit
def at_depth(table: Meridians, indenter: int, depth: float, scale: float, out: Array) -> None:
    """Fill out (T, 2 Q) with the meridian at a depth, times scale.

    Args:
        table: The fields.
        indenter: Index of the indenter.
        depth: Depth, mm.
        scale: Factor on all quantities.
        out: (T, 2 Q), filled.
    """
    at = depth / table.depth_step
    row = min(max(int(at), 0), table.value.shape[1] - 2)
    a, b, c, d = hermite(at - row, table.depth_step)
    a, b, c, d = scale * a, scale * b, scale * c, scale * d
    value, rate = table.value[indenter], table.rate[indenter]
    for t in range(out.shape[0]):
        for q in range(out.shape[1]):
            out[t, q] = (
                a * value[row, t, q]
                + b * rate[row, t, q]
                + c * value[row + 1, t, q]
                + d * rate[row + 1, t, q]
            )


@jit
def at_polar(meridian: Array, step: float, polar: float, quantity: int) -> float:
    """Return one quantity at an angle.

    Beyond the last node, which is the clamped rim of a press at the apex, it fades to zero over
    FADE_RAD: the skin ends its motion there, but not the turn of its normal.

    Args:
        meridian: (T, 2 Q) quantities, each with its slope.
        step: Step of the angles, rad.
        polar: Angle from the contact, rad.
        quantity: Index of the quantity.
    """
    at = polar / step
    last, k = meridian.shape[0] - 1, 2 * quantity
    if at > last:
        beyond = min((polar - last * step) / FADE_RAD, 1.0)
        a, b, c, d = hermite(beyond, FADE_RAD)
        faded: float = a * meridian[last, k] + b * meridian[last, k + 1]
        return faded
    left = min(int(at), last - 1)
    a, b, c, d = hermite(at - left, step)
    value: float = (
        a * meridian[left, k]
        + b * meridian[left, k + 1]
        + c * meridian[left + 1, k]
        + d * meridian[left + 1, k + 1]
    )
    return value


@jit
def quantity_at(table: Meridians, indenter: int, depth: float, polar: float, q: int) -> float:
    """Return quantity q of an indenter at a depth, mm, and an angle, rad; 0: inward, mm."""
    at, up = polar / table.polar_step, depth / table.depth_step
    last = table.value.shape[2] - 1
    if at > last:
        return 0.0
    t, row = min(int(at), last - 1), min(max(int(up), 0), table.value.shape[1] - 2)
    wa, wd = hermite(at - t, table.polar_step), hermite(up - row, table.depth_step)
    value, rate = table.value[indenter], table.rate[indenter]
    total = 0.0
    for k in range(2):
        for slope in range(2):
            c = 2 * q + slope
            node = wd[0] * value[row, t + k, c] + wd[1] * rate[row, t + k, c]
            node += wd[2] * value[row + 1, t + k, c] + wd[3] * rate[row + 1, t + k, c]
            total += wa[2 * k + slope] * node
    return total


@jit
def weights(fraction: float) -> tuple[float, float, float, float]:
    """Return the values of the four uniform cubic B-splines that reach a place between nodes."""
    f, g = fraction, 1.0 - fraction
    return (
        g * g * g / 6.0,
        (4.0 + 3.0 * f * f * (f - 2.0)) / 6.0,
        (4.0 + 3.0 * g * g * (g - 2.0)) / 6.0,
        f * f * f / 6.0,
    )


@jit
def place(value: float, step: float, nodes: int) -> tuple[int, float]:
    """Return the index of the first of four coefficients and the place between the middle two.

    Args:
        value: Value on an axis.
        step: Step of its nodes.
        nodes: Number of nodes.
    """
    at = value / step
    left = min(max(math.floor(at), 0), nodes - 2)
    return left, min(max(at - left, 0.0), 1.0)


@jit
def blend(modes: Array, amounts: Array, out: Array) -> None:
    """Fill out (N,) with the sum of amounts (R,) times modes (R, N). R is a multiple of 4."""
    for first in range(0, len(out), _STRETCH):
        last = min(first + _STRETCH, len(out))
        out[first:last] = 0.0
        for k in range(0, len(amounts), 4):  # four at a time: fewer passes over out
            a, b, c, d = amounts[k], amounts[k + 1], amounts[k + 2], amounts[k + 3]
            m0, m1, m2, m3 = modes[k], modes[k + 1], modes[k + 2], modes[k + 3]
            for i in range(first, last):
                out[i] += a * m0[i] + b * m1[i] + c * m2[i] + d * m3[i]


@jit
def look_up(
    grid: Array, step: float, start: float, frame: Array, x: float, y: float, z: float
) -> Six:
    """Return six numbers along e, f, m of a blended patch in the direction (x, y, z).

    Beyond its border the patch has the value at the border.

    Args:
        grid: (A + 2, B + 2, 6) spline coefficients.
        step: Step of the grid, chords.
        start: First place along e, chords.
        frame: (3, 3) with rows e, f, m.
        x: Component of a unit vector.
        y: Component of a unit vector.
        z: Component of a unit vector.
    """
    along = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z
    across = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z
    up = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z
    stretch = math.sqrt(2.0 / max(1.0 + up, 1e-9))  # Lambert's equal-area chart
    a, b = stretch * along - start, abs(stretch * across)
    i, at = place(a, step, grid.shape[0] - 2)
    j, beside = place(b, step, grid.shape[1] - 2)
    wa, wb = weights(at), weights(beside)
    u0, u1, u2, q0, q1, q2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(4):
        for q in range(4):
            weight = wa[p] * wb[q]
            u0 += weight * grid[i + p, j + q, 0]
            u1 += weight * grid[i + p, j + q, 1]
            u2 += weight * grid[i + p, j + q, 2]
            q0 += weight * grid[i + p, j + q, 3]
            q1 += weight * grid[i + p, j + q, 4]
            q2 += weight * grid[i + p, j + q, 5]
    mirror = -1.0 if across < 0.0 else 1.0
    return u0, mirror * u1, u2, q0, mirror * q1, q2


@jit
def couple(
    skin: Meridians, pairs: Pairs, table: Index, n: Array, delta: Array
) -> tuple[Array, Array, Array]:
    """Return the loads a, s (S, K) and the strengths (S, K, K) of the pairs' corrections.

    Scenes are solved one by one.

    Args:
        skin: Fields of the outer skin.
        pairs: Pair corrections of the outer skin.
        table: (S,) indices of the indenters.
        n: (S, K, 3) directions of the tips.
        delta: (S, K) penetrations, mm.
    """
    amplitude, shape = np.zeros_like(delta), np.zeros_like(delta)
    strength = np.ones((*delta.shape, delta.shape[1]))
    for scene in range(len(delta)):
        near = np.flatnonzero(delta[scene] > -REACH_MM)
        if not (delta[scene] > 0).any():
            continue
        if len(near) == 1:
            amplitude[scene, near[0]], shape[scene, near[0]] = 1.0, delta[scene, near[0]]
            continue
        # In a fixed order, or the result for coincident tips would depend on theirs.
        near = _ordered(near, n[scene], delta[scene])
        at, deep = n[scene][near], delta[scene][near]
        effective, depth = _share(skin, table[scene], at, deep, np.zeros(len(near)))
        among = np.ones((len(near), len(near)))
        if len(near) > 2 and table[scene] == pairs.indenter:
            effective, depth, among = _share_again(
                skin, pairs, table[scene], at, deep, effective, depth
            )
        for i, tip in enumerate(near):
            for j, other in enumerate(near):
                first = fade(_load_at(i, j, at, effective, depth))
                second = fade(_load_at(j, i, at, effective, depth))
                strength[scene, tip, other] = among[i, j] * first * second
        for i, tip in enumerate(near):
            if effective[i] > 0:
                amplitude[scene, tip], shape[scene, tip] = effective[i] / depth[i], depth[i]
    return amplitude, shape, strength


@jit
def _share_again(
    skin: Meridians,
    pairs: Pairs,
    table: int,
    n: Array,
    delta: Array,
    effective: Array,
    depth: Array,
) -> tuple[Array, Array, Array]:
    """Return effective depths, shapes and pair strengths (K, K) of more than two contacts.

    A pair's correction also moves the skin under a third contact, which then carries more or less.
    Its strength follows the loads that the pair still has:
    ((a_i a_j) / (a_i a_j of the pair alone))^POWER.
    """
    count = len(delta)
    moved, alone = np.zeros((count, count, count)), np.ones((count, count))
    six, frame = np.empty(6), np.empty((3, 3))
    amounts = np.empty(len(pairs.modes.grid))
    for i in range(count):
        for j in range(i + 1, count):
            two = np.array([i, j])
            e, s = _share(skin, table, n[two], delta[two], np.zeros(2))
            alone[i, j] = e[0] * e[1] / max(s[0] * s[1], _SHALLOW)
            if pair_strengths(pairs, n[i], n[j], delta[i], delta[j], frame, amounts):
                for k in range(count):
                    if k not in (i, j):
                        patch_at(pairs.modes, amounts, frame, n[k], six)
                        inward = 0.0
                        for c in range(3):
                            inward -= turned(frame, six[0], six[1], six[2], c) * n[k, c]
                        apart = (1.0 - same(n[k], n[i])) * (1.0 - same(n[k], n[j]))
                        moved[i, j, k] = apart * inward
    strength, extra = np.ones((count, count)), np.full(count, np.inf)
    for _ in range(_ROUNDS):
        before, extra = extra, np.zeros(count)
        for i in range(count):
            for j in range(i + 1, count):
                first = _load_at(i, j, n, effective, depth)
                second = _load_at(j, i, n, effective, depth)
                ratio = 1.0
                if alone[i, j] > _SHALLOW:
                    ratio = min(max(first * second / alone[i, j], 0.0), 1.0)
                shares = own_share(i, j, n, effective) * own_share(j, i, n, effective)
                strength[i, j] = strength[j, i] = shares * ratio**POWER
                for k in range(count):
                    extra[k] += strength[i, j] * fade(first) * fade(second) * moved[i, j, k]
        if np.abs(extra - before).max() < 1e-10:
            break
        effective, depth = _share(skin, table, n, delta, extra)
    return effective, depth, strength


@jit
def _load_at(i: int, but: int, n: Array, effective: Array, depth: Array) -> float:
    """Return the amplitude of all contacts at the place of contact i together, without ``but``."""
    total = effective[i] + load_beside(i, but, n, effective)
    return total / depth[i] if depth[i] > 0.0 else 0.0


@jit
def _ordered(tips: Index, n: Array, delta: Array) -> Index:
    """Return the tips in order, deepest first, then by direction."""
    out = tips.copy()
    for i in range(1, len(out)):
        for j in range(i, 0, -1):
            a, b = out[j - 1], out[j]
            if (delta[a], n[b, 0], n[b, 1]) >= (delta[b], n[a, 0], n[a, 1]):
                break
            out[j - 1], out[j] = b, a
    return out


@jit
def same(first: Array, second: Array) -> float:
    """Return 1 for contacts at one place, falling smoothly to 0 where they are _APART rad apart.

    Args:
        first: (3,) direction of one contact.
        second: (3,) direction of the other contact.
    """
    gap = second - first
    left = 1.0 - (gap * gap).sum() / (_APART * _APART)
    return left * left if left > 0.0 else 0.0


@jit
def fade(amplitude: float) -> float:
    """Return 1 for a contact that carries load, falling smoothly to 0 for one without load."""
    x = min(amplitude / _LIGHT, 1.0)
    return x * x * (3.0 - 2.0 * x)


@jit
def load_beside(i: int, but: int, n: Array, effective: Array) -> float:
    """Return the effective depth of others at the place of contact i, without those at ``but``.

    Args:
        i: Index of the contact.
        but: Index of the contact whose place is left out.
        n: (K, 3) directions.
        effective: (K,) effective depths, mm.
    """
    others = 0.0
    for j in range(len(effective)):
        if j != i and j != but:
            others += effective[j] * same(n[i], n[j]) * (1.0 - same(n[j], n[but]))
    return others


@jit
def own_share(i: int, but: int, n: Array, effective: Array) -> float:
    """Return the share of its place that belongs to contact i; contacts at one place divide it."""
    others = load_beside(i, but, n, effective)
    return 1.0 - others / (effective[i] + others) if others > 0.0 else 1.0


@jit
def _share(
    skin: Meridians, table: int, n: Array, delta: Array, extra: Array
) -> tuple[Array, Array]:
    """Return effective depths e and shape depths s, each (K,), mm, of one scene.

    Args:
        skin: Fields of the outer skin.
        table: Index of the indenter.
        n: (K, 3) directions of the tips.
        delta: (K,) penetrations, mm.
        extra: (K,) mm by which the skin under each tip has moved inward without the loads.
    """
    count = len(delta)
    effective, shape = np.zeros(count), np.maximum(delta, 0.0)
    matrix = np.empty((count, count))
    deepest = skin.depth_step * (skin.value.shape[1] - 1)
    for _ in range(_ROUNDS):
        for j in range(count):
            depth = max(shape[j], _SHALLOW)
            under = quantity_at(skin, table, depth, 0.0, 0)
            for i in range(count):
                angle = math.acos(min(max((n[i] * n[j]).sum(), -1.0), 1.0))
                matrix[i, j] = quantity_at(skin, table, depth, angle, 0) / under
        _complementarity(matrix, delta - extra, effective)
        grown = np.maximum(delta, 0.0)
        for i in range(count):
            together = 0.0
            for j in range(count):
                together += effective[j] * same(n[i], n[j])
            grown[i] = min(max(grown[i], together), deepest)
        change = np.abs(grown - shape).max()
        shape = grown
        if change <= 1e-13:
            break
    return effective, shape


@jit
def _complementarity(matrix: Array, delta: Array, effective: Array) -> None:
    """Solve e >= 0, M e - delta >= 0, complementary: projected Gauss-Seidel, then exactly."""
    effective[:] = 0.0
    for sweeps in (20, 80, 400, 2000):
        for _ in range(sweeps):
            for i in range(len(delta)):
                rest = (matrix[i] * effective).sum() - matrix[i, i] * effective[i]
                effective[i] = max(0.0, delta[i] - rest)
        exact = _solve(matrix, delta, effective > 0)
        if (exact >= -1e-12).all():
            gap = matrix @ exact - delta
            if (gap > -1e-8).all():
                for i in range(len(delta)):
                    effective[i] = max(exact[i], 0.0)
                return


@jit
def _solve(matrix: Array, delta: Array, active: npt.NDArray[np.bool_]) -> Array:
    """Return the solution for a given active set; zero elsewhere."""
    system, right = np.eye(len(delta)), np.zeros(len(delta))
    for i in range(len(delta)):
        if active[i]:
            right[i] = delta[i]
            for j in range(len(delta)):
                if i != j and active[j]:
                    system[i, j] = (1.0 - _REGULAR) * matrix[i, j]
    return np.linalg.solve(system, right)  # type: ignore[return-value]  # float64, as its input


@jit
def turned(frame: Array, along: float, across: float, up: float, k: int) -> float:
    """Return component k of a vector given along e, f, m."""
    component: float = frame[0, k] * along + frame[1, k] * across + frame[2, k] * up
    return component


@jit
def side_frame(n: Array, frame: Array) -> None:
    """Fill the rows of frame with e (down the dome's side), f, n. n must not be the apex."""
    sine = math.hypot(n[0], n[1])
    frame[0, 0], frame[0, 1], frame[0, 2] = n[0] * n[2] / sine, n[1] * n[2] / sine, -sine
    frame[1, 0], frame[1, 1], frame[1, 2] = -n[1] / sine, n[0] / sine, 0.0
    frame[2, 0], frame[2, 1], frame[2, 2] = n[0], n[1], n[2]


@jit
def pair_frame(first: Array, second: Array, frame: Array) -> None:
    """Fill the rows with e (from first to second), f, m (between). They must not coincide."""
    e, m = second - first, second + first
    e, m = e / math.sqrt((e * e).sum()), m / math.sqrt((m * m).sum())
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        frame[0, k], frame[1, k], frame[2, k] = e[k], m[i] * e[j] - m[j] * e[i], m[k]


@jit
def around_amounts(around: Around, indenter: int, beta: float, depth: float, out: Array) -> None:
    """Fill out (R,) with the amounts of the modes of O.

    Args:
        around: O of all indenters.
        indenter: Index of the indenter.
        beta: Polar angle of the contact, rad.
        depth: Depth, mm.
        out: (R,), filled.
    """
    table = around.amounts[indenter]
    i, x = place(beta, around.beta_step, table.shape[0] - 2)
    j, y = place(depth, around.depth_step, table.shape[1] - 2)
    wx, wy = weights(x), weights(y)
    out[:] = 0.0
    for p in range(4):
        for q in range(4):
            out += wx[p] * wy[q] * table[i + p, j + q]


@jit
def pair_amounts(pairs: Pairs, angle: float, first: float, second: float, out: Array) -> None:
    """Fill out (R,) with the amounts of the modes of C.

    Args:
        pairs: C of one indenter.
        angle: Angle between the two contacts, rad.
        first: Penetration of the first contact, mm.
        second: Penetration of the second contact, mm.
        out: (R,), filled.
    """
    table = pairs.amounts
    h, v = place(angle, pairs.angle_step, table.shape[0] - 2)
    i, x = place(first, pairs.depth_step, table.shape[1] - 2)
    j, y = place(second, pairs.depth_step, table.shape[2] - 2)
    wv, wx, wy = weights(v), weights(x), weights(y)
    out[:] = 0.0
    for o in range(4):
        for p in range(4):
            for q in range(4):
                out += wv[o] * wx[p] * wy[q] * table[h + o, i + p, j + q]


@jit
def pair_strengths(
    pairs: Pairs, a: Array, b: Array, first: float, second: float, frame: Array, amounts: Array
) -> bool:
    """Fill frame and amounts of the modes of two contacts; False where there is no correction.

    Args:
        pairs: Corrections of pairs.
        a: (3,) direction of the first contact.
        b: (3,) direction of the second contact.
        first: Penetration of the first contact, mm.
        second: Penetration of the second contact, mm.
        frame: (3, 3), filled with rows e, f, m.
        amounts: (R,), filled.
    """
    if not (first > 0.0 and second > 0.0):
        return False
    gap = b - a
    angle = 2.0 * math.asin(min(0.5 * math.sqrt((gap * gap).sum()), 1.0))
    if not _APEX < angle < pairs.angle_step * (len(pairs.amounts) - 3):
        return False
    pair_frame(a, b, frame)
    pair_amounts(pairs, angle, first, second, amounts)
    return True


@jit
def patch_at(modes: Modes, amounts: Array, frame: Array, direction: Array, out: Array) -> None:
    """Fill out (6,) with a patch in one direction, without blending all of the patch.

    Args:
        modes: The modes.
        amounts: (R,) amounts of the modes.
        frame: (3, 3) with rows e, f, m.
        direction: (3,) unit vector.
        out: (6,) displacement, mm, and turn, rad, along e, f, m, filled.
    """
    out[:] = 0.0
    x, y, z = direction[0], direction[1], direction[2]
    for k in range(len(amounts)):
        part = look_up(modes.grid[k], modes.step, modes.start, frame, x, y, z)
        for c in range(6):
            out[c] += amounts[k] * part[c]


@jit
def push_aside(
    skin: Meridians,
    pairs: Pairs,
    table: Index,
    n: Array,
    delta: Array,
    amplitude: Array,
    shape: Array,
    strength: Array,
) -> Array:
    """Return (S, K, 3) mm: how far the normal loads of the others move the skin under each tip.

    It is the motion along the skin, by T of the others and by C of all pairs. O is left out: it
    changes pins by less than 0.002 mm.

    Args:
        skin: Fields of the outer skin.
        pairs: Pair corrections of the outer skin.
        table: (S,) indices of the indenters.
        n: (S, K, 3) directions of the tips.
        delta: (S, K) penetrations, mm.
        amplitude: (S, K) amplitudes a.
        shape: (S, K) shape depths s, mm.
        strength: (S, K, K) strengths of C.
    """
    out = np.zeros(n.shape)
    frame, six, amounts = np.empty((3, 3)), np.empty(6), np.empty(len(pairs.modes.grid))
    for s in range(len(n)):
        for i in range(n.shape[1]):
            for j in range(n.shape[1]):
                if j == i or amplitude[s, j] == 0.0:
                    continue
                a, b = n[s, j], n[s, i]
                cosine = min(max(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], -1.0), 1.0)
                t = quantity_at(skin, table[s], shape[s, j], math.acos(cosine), 1)
                for k in range(3):
                    out[s, i, k] += amplitude[s, j] * t * (b[k] * cosine - a[k])
        for i in range(n.shape[1] if table[s] == pairs.indenter else 0):
            for j in range(i + 1, n.shape[1]):
                if strength[s, i, j] > 0.0 and pair_strengths(
                    pairs, n[s, i], n[s, j], delta[s, i], delta[s, j], frame, amounts
                ):
                    for tip in range(n.shape[1]):
                        patch_at(pairs.modes, amounts, frame, n[s, tip], six)
                        for k in range(3):
                            moved = turned(frame, six[0], six[1], six[2], k)
                            out[s, tip, k] += strength[s, i, j] * moved
        for i in range(n.shape[1]):
            b = n[s, i]
            up = out[s, i, 0] * b[0] + out[s, i, 1] * b[1] + out[s, i, 2] * b[2]
            for k in range(3):
                out[s, i, k] -= up * b[k]
    return out


@jit
def add_single(
    meridian: Array, step: float, n: Array, directions: Array, u: Array, q: Array
) -> None:
    """Add T of one contact.

    Args:
        meridian: (T, 6) w, t / sin and omega / sin with their slopes.
        step: Step of the polar angle, rad.
        n: (3,) direction of the contact.
        directions: (P, 3) unit vectors.
        u: (P, 3) displacement, mm, to which T is added.
        q: (P, 3) turn of the normal, rad, likewise.
    """
    for p in range(len(directions)):
        b = directions[p]
        cosine = min(max(n[0] * b[0] + n[1] * b[1] + n[2] * b[2], -1.0), 1.0)
        polar = math.acos(cosine)
        w = at_polar(meridian, step, polar, 0)
        t = at_polar(meridian, step, polar, 1)
        omega = at_polar(meridian, step, polar, 2)
        for k in range(3):
            away = b[k] * cosine - n[k]  # the tangent away from the contact times sin
            u[p, k] += t * away - w * b[k]
            q[p, k] += omega * away


@jit
def add_patch(
    grid: Array, modes: Modes, frame: Array, directions: Array, u: Array, q: Array
) -> None:
    """Add a blended patch.

    Args:
        grid: (A + 2, B + 2, 6) spline coefficients.
        modes: The modes, whose step and start are taken.
        frame: (3, 3) with rows e, f, m.
        directions: (P, 3) unit vectors.
        u: (P, 3) displacement, mm, to which the patch is added.
        q: (P, 3) turn of the normal, rad, likewise.
    """
    for p in range(len(directions)):
        x, y, z = directions[p, 0], directions[p, 1], directions[p, 2]
        a, b, c, d, e, f = look_up(grid, modes.step, modes.start, frame, x, y, z)
        for k in range(3):
            u[p, k] += turned(frame, a, b, c, k)
            q[p, k] += turned(frame, d, e, f, k)


@jit
def displace(
    n: Array,
    delta: Array,
    amplitude: Array,
    shape: Array,
    table: Index,
    strength: Array,
    singles: Meridians,
    around: Around,
    pairs: Pairs,
    directions: Array,
) -> tuple[Array, Array]:
    """Return u mm and q rad, each (S, P, 3), of S scenes at P directions.

    Args:
        n: (S, K, 3) directions of the tips.
        delta: (S, K) penetrations, mm.
        amplitude: (S, K) amplitudes a.
        shape: (S, K) shape depths s, mm.
        table: (S,) indices of the indenters.
        strength: (S, K, K) strengths of C.
        singles: T of the indenters.
        around: O of the indenters.
        pairs: C of one indenter.
        directions: (P, 3) unit vectors.
    """
    count = (len(n), len(directions), 3)
    u, q = np.zeros(count), np.zeros(count)
    meridian = np.empty(singles.value.shape[2:])
    near_modes = around.modes.grid.reshape(len(around.modes.grid), -1)
    pair_modes = pairs.modes.grid.reshape(len(pairs.modes.grid), -1)
    near_grid = np.empty(around.modes.grid.shape[1:])
    pair_grid = np.empty(pairs.modes.grid.shape[1:])
    near_amounts, amounts = np.empty(len(near_modes)), np.empty(len(pair_modes))
    frame = np.empty((3, 3))
    for s in range(len(n)):
        for i in range(n.shape[1]):
            a, depth = amplitude[s, i], shape[s, i]
            if a == 0.0:
                continue
            at_depth(singles, table[s], depth, a, meridian)
            add_single(meridian, singles.polar_step, n[s, i], directions, u[s], q[s])
            if math.hypot(n[s, i, 0], n[s, i, 1]) > _APEX:
                side_frame(n[s, i], frame)
                beta = math.acos(min(n[s, i, 2], 1.0))
                around_amounts(around, table[s], beta, depth, near_amounts)
                near_amounts *= a
                blend(near_modes, near_amounts, near_grid.reshape(-1))
                add_patch(near_grid, around.modes, frame, directions, u[s], q[s])
        for i in range(n.shape[1] if table[s] == pairs.indenter else 0):
            for j in range(i + 1, n.shape[1]):
                if strength[s, i, j] > 0.0 and pair_strengths(
                    pairs, n[s, i], n[s, j], delta[s, i], delta[s, j], frame, amounts
                ):
                    amounts *= strength[s, i, j]
                    blend(pair_modes, amounts, pair_grid.reshape(-1))
                    add_patch(pair_grid, pairs.modes, frame, directions, u[s], q[s])
        for p in range(len(directions)):  # a turn has no part along the normal
            b = directions[p]
            along = q[s, p, 0] * b[0] + q[s, p, 1] * b[1] + q[s, p, 2] * b[2]
            for k in range(3):
                q[s, p, k] -= along * b[k]
    return u, q
