"""Several tips at once: forces on the nodes of all their lattices under one complementarity."""

from __future__ import annotations

import math

import numpy as np

from tactibench_sim.compiled import jit
from tactibench_sim.green.complementarity import Mask, solve
from tactibench_sim.green.lattice import nodes
from tactibench_sim.green.lookup import (
    Array,
    Index,
    at_cap,
    at_force,
    chord_of,
    share_of_load,
)
from tactibench_sim.green.single import reach

CAP = 2.0
"""Radius of the caps in lattice spacings."""
SETTLED = 1e-11
"""Relative change of the loads below which a scene is solved."""
REACH_MM = 0.4
"""Nodes farther above the skin are left out; no bulge is as high."""
_SWEEPS = 60
_REGULAR = 1e-8  # of the diagonal: splits the load of coincident tips evenly


@jit
def influence(
    points: Array, tip: Index, tables: Array, modes: Array, step: float
) -> tuple[Array, Array]:
    """Return outer w at a node per unit force on another: (n, n), softening modes (M, n, n).

    tables: (K, K, C, 4) cubics in the chord for two tips; modes: (M, C, 4).
    """
    count, cells = len(points), modes.shape[1]
    stiff, soft = np.zeros((count, count)), np.zeros((len(modes), count, count))
    for i in range(count):
        for j in range(i + 1):
            chord = chord_of(points[i], points[j])
            cell = int(chord / step)
            if cell >= cells:
                continue
            x = chord - cell * step
            c = tables[tip[i], tip[j], cell]
            stiff[i, j] = stiff[j, i] = ((c[3] * x + c[2]) * x + c[1]) * x + c[0]
            for m in range(len(modes)):
                c = modes[m, cell]
                soft[m, i, j] = soft[m, j, i] = ((c[3] * x + c[2]) * x + c[1]) * x + c[0]
    return stiff, soft


@jit
def target_displacement(points: Array, n: Array, delta: Array, radius: float, dome: float) -> Array:
    """Return (n,) inward displacement along its normal at which each node meets any tip."""
    out = np.full(len(points), -1e9)
    for i in range(len(points)):
        for j in range(len(n)):
            theta = 2 * math.asin(min(1.0, chord_of(points[i], n[j]) / 2))
            out[i] = max(out[i], dome - reach(theta, radius, delta[j], dome))
    return out


@jit
def equilibrium(
    stiff: Array,
    soft: Array,
    tip: Index,
    depth: Array,
    near: Array,
    load: Array,
    active: Mask,
    knots: Array,
    shares: Array,
) -> tuple[Array, Array, bool]:
    """Return forces (n,) on nodes and softening shares (K, M) of tips that fit each other.

    stiff: (n, n), soft: (M, n, n), tip: (n,) of each node, near: (K, n) how much a node's force
    softens a tip, load: (K,) and active: (n,) a guess, then the solution.
    """
    count = len(load)
    share = np.zeros((count, len(soft)))
    before, gain = np.zeros(count), np.zeros(count)
    a = np.empty_like(stiff)
    for sweep in range(_SWEEPS):
        for i in range(count):
            share[i] = at_force(knots, shares, load[i])
        for p in range(len(tip)):
            for q in range(p + 1):
                total = stiff[p, q]
                for m in range(len(soft)):
                    total += (share[tip[p], m] + share[tip[q], m]) / 2 * soft[m, p, q]
                a[p, q] = a[q, p] = total
            a[p, p] *= 1 + _REGULAR
        force, fine = solve(a, depth, active)
        if not fine:
            return force, share, False
        change = near @ force - load
        if np.abs(change).max() < SETTLED:
            return force, share, True
        for i in range(count):  # one secant per tip: the loads hardly feel each other
            slope = (change[i] - before[i]) / gain[i] if sweep and abs(gain[i]) > 1e-12 else -1.0
            gain[i] = -change[i] / min(max(slope, -2.0), -0.5)
            before[i] = change[i]
            load[i] += gain[i]
    return force, share, False


@jit
def press(
    hexagon: Array,
    n: Array,
    delta: Array,
    radius: float,
    dome: float,
    spacing: Array,
    alone: Array,
    step: float,
    log_cap: Array,
    caps: Array,
    modes: Array,
    knots: Array,
    shares: Array,
) -> tuple[Array, Array, Array, Array, Array, bool]:
    """Solve one scene of K tips.

    n: (K, 3), delta: (K,), spacing: (K,) mm of the lattices, alone: (K,) load of each by itself.
    Returns directions (K, N, 3) of the nodes, their forces together (K, N) and alone (K, N), and
    the softening shares of each tip together (K, M) and alone (K, M); False: did not settle.
    """
    count, size = len(n), len(hexagon)
    spread = nodes(hexagon, n, alone + 1e-9, spacing, dome)
    points = spread.reshape(count * size, 3)
    tip = np.repeat(np.arange(count), size)
    depth = target_displacement(points, n, delta, radius, dome)
    own = np.empty(len(points))
    for i in range(count):
        span = slice(i * size, (i + 1) * size)
        own[span] = target_displacement(points[span], n[i : i + 1], delta[i : i + 1], radius, dome)
    # Where another tip reaches deeper, its own lattice stands.
    use = np.flatnonzero((own > -REACH_MM) & (own > depth - 1e-9))
    used, depth = tip[use], depth[use]
    where = points[use]
    cells = modes.shape[1]
    tables, outer = np.empty((count, count, cells, 4)), modes[:, :, 0].copy()
    for i in range(count):
        for j in range(i + 1):  # the root mean square keeps the influence of two sizes positive
            both = CAP * math.sqrt((spacing[i] ** 2 + spacing[j] ** 2) / 2)
            tables[i, j] = at_cap(log_cap, caps, both)[:, 0]
            tables[j, i] = tables[i, j]
    stiff, soft = influence(where, used, tables, outer, step)
    near = np.empty((count, len(use)))
    for i in range(count):
        for k in range(len(use)):
            near[i, k] = share_of_load(chord_of(n[i], where[k]))

    forces, share = np.zeros((2, count, size)), np.zeros((2, count, len(modes)))
    good = True
    active = np.zeros(len(use), dtype=np.bool_)
    load = np.zeros(count)
    for i in range(count):
        if delta[i] <= 0:
            continue
        first = i * size
        mine = first + np.flatnonzero(own[first : first + size] > -REACH_MM)
        where_i, zero = points[mine], np.zeros(len(mine), dtype=np.int64)
        one = tables[i : i + 1, i : i + 1].copy()
        stiff_i, soft_i = influence(where_i, zero, one, outer, step)
        near_i = np.empty((1, len(mine)))
        for k in range(len(mine)):
            near_i[0, k] = share_of_load(chord_of(n[i], where_i[k]))
        guess = own[mine] > 0.6 * delta[i]
        start = alone[i : i + 1].copy()
        force, share_i, fine = equilibrium(
            stiff_i, soft_i, zero, own[mine], near_i, start, guess, knots, shares
        )
        good = good and fine
        share[1, i], load[i] = share_i[0], start[0]
        forces[1, i, mine - first] = force
    for k in range(len(use)):
        active[k] = forces[1, used[k], use[k] - used[k] * size] > 0
    force, together, fine = equilibrium(stiff, soft, used, depth, near, load, active, knots, shares)
    for k in range(len(use)):
        forces[0, used[k], use[k] - used[k] * size] = force[k]
    return spread, forces[0], forces[1], together, share[1], good and fine
