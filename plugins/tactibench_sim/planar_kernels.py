"""The flat pad's compiled loops: table look-ups, shared loads and fields.

A table is (D, T, Q, 4): by depth, distance and quantity the value and its derivatives by distance,
by depth and by both, a bicubic spline in Hermite form.
"""

# One file: numba's cache on disk follows changes of the file of the function that is called.

from __future__ import annotations

import numpy as np

from tactibench_sim.compiled import jit

_SHALLOW = 1e-6  # depth, mm, whose shape is taken for a tip that does not press yet
_REGULAR = 1e-10  # splits the load of exactly coincident tips evenly
_APART = 1.0  # mm from which tips are separate; nothing depends on it for protocols' indenters
_ROUNDS = 60  # two or three are enough, unless a bulge lifts a tip
_SWEEPS = (20, 80, 400, 2000)
"""Sweeps of Gauss-Seidel, tried in turn until it has converged."""


@jit
def hermite(f, step):  # type: ignore[no-untyped-def]
    """Return the weights of (value, slope) at the left and (value, slope) at the right node."""
    g = 1.0 - f
    return g * g * (1.0 + 2.0 * f), step * f * g * g, f * f * (3.0 - 2.0 * f), -step * f * f * g


@jit
def at_depth(table, step, depth, scale, out):  # type: ignore[no-untyped-def]
    """Fill out (N, Q, 2) with value and slope of the first N nodes at one depth, times scale.

    Args:
        table: (D, T, Q, 4) table.
        step: Step of the depths, mm.
        depth: Depth, mm.
        scale: Factor on all quantities.
        out: (N, Q, 2), filled.
    """
    place = depth / step
    left = min(int(place), table.shape[0] - 2)
    a, b, c, d = hermite(place - left, step)
    near, far = table[left], table[left + 1]
    for k in range(out.shape[0]):
        for q in range(out.shape[1]):
            for s in range(2):
                out[k, q, s] = scale * (
                    a * near[k, q, s]
                    + b * near[k, q, 2 + s]
                    + c * far[k, q, s]
                    + d * far[k, q, 2 + s]
                )


@jit
def at_distance(profile, step, r, q):  # type: ignore[no-untyped-def]
    """Return quantity q of a profile (N, Q, 2) with steps of ``step`` mm at r mm; 0 beyond it."""
    place = r / step
    if not place < profile.shape[0] - 1:
        return 0.0
    left = int(place)
    a, b, c, d = hermite(place - left, step)
    near, far = profile[left, q], profile[left + 1, q]
    return a * near[0] + b * near[1] + c * far[0] + d * far[1]


@jit
def depression(table, steps, depth, r, pair):  # type: ignore[no-untyped-def]
    """Return quantity 0 of a table at a depth and a distance.

    Args:
        table: (D, T, Q, 4) table.
        steps: (2,) steps of depth and distance, mm.
        depth: Depth, mm.
        r: Distance from the tip's axis, mm.
        pair: (2, Q, 2) scratch memory.
    """
    left = int(r / steps[1])
    if left > table.shape[1] - 2:
        return 0.0
    at_depth(table[:, left : left + 2], steps[0], depth, 1.0, pair)
    a, b, c, d = hermite(r / steps[1] - left, steps[1])
    return a * pair[0, 0, 0] + b * pair[0, 0, 1] + c * pair[1, 0, 0] + d * pair[1, 0, 1]


@jit
def displace(tables, steps, index, xy, amplitude, shape, points, out):  # type: ignore[no-untyped-def]
    """Add the displacement of points by S presses; z is out of the pad.

    Args:
        tables: (M, D, T, 2, 4) tables of w, mm, and t / r.
        steps: (2,) steps of depth and distance, mm.
        index: (S,) table of each press.
        xy: (S, K, 2) places of the tips, mm.
        amplitude: (S, K) factors on the tabulated fields; 0: the tip does not press.
        shape: (S, K) depths whose fields the tips have, mm.
        points: (P, 2) mm.
        out: (S, P, 3) mm, to which the displacement is added.
    """
    buffer = np.empty((tables.shape[2], 2, 2))
    for s in range(xy.shape[0]):
        for k in range(xy.shape[1]):
            if amplitude[s, k] == 0.0:
                continue
            farthest = 0.0
            for p in range(points.shape[0]):
                dx, dy = points[p, 0] - xy[s, k, 0], points[p, 1] - xy[s, k, 1]
                farthest = max(farthest, dx * dx + dy * dy)
            profile = buffer[: min(buffer.shape[0], int(np.sqrt(farthest) / steps[1]) + 3)]
            at_depth(tables[index[s]], steps[0], shape[s, k], amplitude[s, k], profile)
            for p in range(points.shape[0]):
                dx, dy = points[p, 0] - xy[s, k, 0], points[p, 1] - xy[s, k, 1]
                r = np.sqrt(dx * dx + dy * dy)
                away = at_distance(profile, steps[1], r, 1)
                out[s, p, 0] += away * dx
                out[s, p, 1] += away * dy
                out[s, p, 2] -= at_distance(profile, steps[1], r, 0)


@jit
def couple(tables, steps, index, xy, delta, reach, amplitude, shape):  # type: ignore[no-untyped-def]
    """Fill amplitude and shape of tips that share the load of S presses.

    Effective depths e_i and shapes s_i fulfil

        e_i >= 0,   g_i = sum_j e_j w(|x_i - x_j|; s_j) / w(0; s_j) - delta_i >= 0,   e_i g_i = 0,
        s_i = max(delta_i, sum_j e_j same(|x_i - x_j|)),  at most the deepest of the table,

    and amplitude_i = e_i / s_i. Tips at one place press as one: ``same`` is 1 there and 0 from
    _APART on. Tips more than ``reach`` above the surface take no part.

    Args:
        tables: (M, D, T, 1, 4) tables of the surface's depression, mm.
        steps: (2,) steps of depth and distance, mm.
        index: (S,) table of each press.
        xy: (S, K, 2) places of the tips, mm.
        delta: (S, K) depths of the tips, mm; -inf for no tip.
        reach: Greatest height of a tip that takes part, mm.
        amplitude: (S, K), filled.
        shape: (S, K) mm, filled.
    """
    count = xy.shape[1]
    pair = np.empty((2, 1, 2))
    deepest = steps[0] * (tables.shape[1] - 1)
    matrix, effective, alone = np.empty((count, count)), np.empty(count), np.empty(count)
    for s in range(xy.shape[0]):
        near = delta[s] > -reach
        pressing = 0
        for i in range(count):
            alone[i] = max(delta[s, i], 0.0)
            shape[s, i] = alone[i]
            amplitude[s, i] = 1.0 if alone[i] > 0.0 else 0.0
            pressing += alone[i] > 0.0
        if near.sum() < 2 or pressing == 0:
            continue
        order = _deepest_first(delta[s], xy[s])
        for _ in range(_ROUNDS):
            for j in range(count):
                depth = max(shape[s, j], _SHALLOW)
                under = depression(tables[index[s]], steps, depth, 0.0, pair)
                for i in range(count):
                    dx, dy = xy[s, i, 0] - xy[s, j, 0], xy[s, i, 1] - xy[s, j, 1]
                    r = np.sqrt(dx * dx + dy * dy)
                    matrix[i, j] = 0.0
                    if near[i] and near[j]:
                        w = depression(tables[index[s]], steps, depth, r, pair)
                        matrix[i, j] = w / under
            complementary(matrix, delta[s], near, order, effective)
            changed = 0.0
            for i in range(count):
                together = 0.0
                for j in range(count):
                    dx, dy = xy[s, i, 0] - xy[s, j, 0], xy[s, i, 1] - xy[s, j, 1]
                    square = (dx * dx + dy * dy) / (_APART * _APART)
                    if square < 1.0:
                        together += effective[j] * (1.0 - square) * (1.0 - square)
                grown = min(max(alone[i], together), deepest)
                changed = max(changed, abs(grown - shape[s, i]))
                shape[s, i] = grown
            if changed <= 1e-13:
                break
        for i in range(count):
            if effective[i] > 0.0:
                amplitude[s, i] = effective[i] / shape[s, i]
            else:
                amplitude[s, i] = shape[s, i] = 0.0


@jit
def _deepest_first(delta, xy):  # type: ignore[no-untyped-def]
    """Return the order of tips: deepest first, then by place.

    Without it the result for coincident tips would depend on the order in which they are given.
    """
    order = np.arange(delta.shape[0])
    for i in range(1, order.shape[0]):
        j = i
        while j > 0:
            a, b = order[j - 1], order[j]
            if delta[a] != delta[b]:
                right = delta[a] > delta[b]
            elif xy[a, 0] != xy[b, 0]:
                right = xy[a, 0] < xy[b, 0]
            else:
                right = xy[a, 1] <= xy[b, 1]
            if right:
                break
            order[j - 1], order[j] = b, a
            j -= 1
    return order


@jit
def complementary(matrix, delta, near, order, e):  # type: ignore[no-untyped-def]
    """Solve e >= 0, M e - delta >= 0, complementary: projected Gauss-Seidel, then exactly.

    Args:
        matrix: (K, K) M with diagonal 1.
        delta: (K,) depths, mm.
        near: (K,) whether a tip takes part.
        order: (K,) order of the tips.
        e: (K,) effective depths, mm, filled.
    """
    count = delta.shape[0]
    e[:] = 0.0
    for sweeps in _SWEEPS:
        for _ in range(sweeps):
            for i in order:
                if near[i]:
                    rest = 0.0
                    for j in range(count):
                        if j != i:
                            rest += matrix[i, j] * e[j]
                    e[i] = max(0.0, delta[i] - rest)
        exact = _solve_active(matrix, delta, e)
        fits = True
        for i in range(count):
            gap = 0.0
            for j in range(count):
                gap += matrix[i, j] * exact[j]
            if not exact[i] >= -1e-12 or (near[i] and not gap - delta[i] > -1e-8):
                fits = False
        if fits:
            for i in range(count):
                e[i] = max(exact[i], 0.0)
            return


@jit
def _solve_active(matrix, delta, e):  # type: ignore[no-untyped-def]
    """Return the solution for the active set e > 0, zero elsewhere, by Gauss-Jordan with pivots."""
    active = np.flatnonzero(e > 0.0)
    n = active.shape[0]
    system = np.empty((n, n + 1))
    for i in range(n):
        for j in range(n):
            value = matrix[active[i], active[j]]
            system[i, j] = value if i == j else (1.0 - _REGULAR) * value
        system[i, n] = delta[active[i]]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(system[i, k]) > abs(system[best, k]):
                best = i
        for j in range(n + 1):
            system[k, j], system[best, j] = system[best, j], system[k, j]
        for i in range(n):
            if i != k:
                factor = system[i, k] / system[k, k]
                for j in range(k, n + 1):
                    system[i, j] -= factor * system[k, j]
    exact = np.zeros(e.shape[0])
    for i in range(n):
        exact[active[i]] = system[i, n] / system[i, i]
    return exact
