"""The Delaunay triangulation of points in the plane and the areas of its Voronoi cells, compiled.

A sweep outwards from a middle triangle with flips as it goes (the s-hull of Sinclair, 2010, in the
form of Agafonkin's public Delaunator).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_SIDES = 48


@njit(cache=True, nogil=True, error_model="numpy")
def _turn(ax, ay, bx, by, cx, cy):  # type: ignore[no-untyped-def]
    return (ay - cy) * (bx - cx) - (ax - cx) * (by - cy)


@njit(cache=True, nogil=True, error_model="numpy")
def _inside(xy, a, b, c, p):  # type: ignore[no-untyped-def]
    """Is p inside the circle through a, b, c?"""
    dx, dy = xy[a, 0] - xy[p, 0], xy[a, 1] - xy[p, 1]
    ex, ey = xy[b, 0] - xy[p, 0], xy[b, 1] - xy[p, 1]
    fx, fy = xy[c, 0] - xy[p, 0], xy[c, 1] - xy[p, 1]
    ap, bp, cp = dx * dx + dy * dy, ex * ex + ey * ey, fx * fx + fy * fy
    return dx * (ey * cp - bp * fy) - dy * (ex * cp - bp * fx) + ap * (ex * fy - ey * fx) < 0


@njit(cache=True, nogil=True, error_model="numpy")
def _centre(ax, ay, bx, by, cx, cy):  # type: ignore[no-untyped-def]
    """Centre of the circle through three points, from a; inf for points on a line."""
    dx, dy, ex, ey = bx - ax, by - ay, cx - ax, cy - ay
    bl, cl = dx * dx + dy * dy, ex * ex + ey * ey
    area = dx * ey - dy * ex
    if area * area <= 1e-24 * bl * cl:
        return np.inf, np.inf
    return (ey * bl - dy * cl) * 0.5 / area, (dx * cl - ex * bl) * 0.5 / area


@njit(cache=True, nogil=True, error_model="numpy")
def _key(dx, dy, size):  # type: ignore[no-untyped-def]
    total = abs(dx) + abs(dy)
    p = dx / total if total > 0 else 0.0
    angle = (3.0 - p if dy > 0 else 1.0 + p) / 4.0
    return math.floor(angle * size) % size


@njit(cache=True, nogil=True, error_model="numpy")
def _link(half, a, b):  # type: ignore[no-untyped-def]
    half[a] = b
    if b != -1:
        half[b] = a


@njit(cache=True, nogil=True, error_model="numpy")
def _put(corner, half, length, a, b, c, ab, bc, ca):  # type: ignore[no-untyped-def]
    corner[length], corner[length + 1], corner[length + 2] = a, b, c
    _link(half, length, ab)
    _link(half, length + 1, bc)
    _link(half, length + 2, ca)


@njit(cache=True, nogil=True, error_model="numpy")
def _flip(a, xy, corner, half, stack, previous, owned, start):  # type: ignore[no-untyped-def]
    """Flip edge a, and what becomes wrong by it, until circles are empty."""
    waiting, right = 0, 0
    while True:
        b = half[a]
        first = a - a % 3
        right = first + (a + 2) % 3
        if b != -1:
            other = b - b % 3
            left, far = first + (a + 1) % 3, other + (b + 2) % 3
            p0, pr, pl, p1 = corner[right], corner[a], corner[left], corner[far]
            if _inside(xy, p0, pr, pl, p1):
                corner[a], corner[b] = p1, p0
                outer = half[far]
                if outer == -1:  # the edge lay on the hull
                    e = start
                    while True:
                        if owned[e] == far:
                            owned[e] = a
                            break
                        e = previous[e]
                        if e == start:
                            break
                _link(half, a, outer)
                _link(half, b, half[right])
                _link(half, right, far)
                if waiting < len(stack):
                    stack[waiting] = other + (b + 1) % 3
                    waiting += 1
                continue
        if waiting == 0:
            return right
        waiting -= 1
        a = stack[waiting]


@njit(cache=True, nogil=True, error_model="numpy")
def _seed(xy):  # type: ignore[no-untyped-def]
    """Three points near the middle with a small circle; the third is -1 for points on a line."""
    middle = (xy[:, 0].min() + xy[:, 0].max()) / 2, (xy[:, 1].min() + xy[:, 1].max()) / 2
    i0, i1, i2 = -1, -1, -1
    best = np.inf
    for i in range(len(xy)):
        square = (xy[i, 0] - middle[0]) ** 2 + (xy[i, 1] - middle[1]) ** 2
        if square < best:
            best, i0 = square, i
    best = np.inf
    for i in range(len(xy)):
        square = (xy[i, 0] - xy[i0, 0]) ** 2 + (xy[i, 1] - xy[i0, 1]) ** 2
        if 0 < square < best:
            best, i1 = square, i
    if i1 < 0:
        return i0, i1, i2
    best = np.inf
    for i in range(len(xy)):
        if i in (i0, i1):
            continue
        x, y = _centre(xy[i0, 0], xy[i0, 1], xy[i1, 0], xy[i1, 1], xy[i, 0], xy[i, 1])
        if x * x + y * y < best:
            best, i2 = x * x + y * y, i
    if i2 >= 0 and _turn(xy[i0, 0], xy[i0, 1], xy[i1, 0], xy[i1, 1], xy[i2, 0], xy[i2, 1]) < 0:
        i1, i2 = i2, i1
    return i0, i1, i2


@njit(cache=True, nogil=True, error_model="numpy")
def triangulate(xy):  # type: ignore[no-untyped-def]
    """corner (3 T,): points of the triangles; half (3 T,): the same edge in the next, -1: hull.

    Points on a line have no triangle; of points that coincide one has.
    """
    count = len(xy)
    room = max(2 * count - 5, 0) * 3
    corner, half = np.empty(room, np.int64), np.empty(room, np.int64)
    i0, i1, i2 = _seed(xy)
    if i2 < 0:
        return corner[:0], half[:0]
    cx, cy = _centre(xy[i0, 0], xy[i0, 1], xy[i1, 0], xy[i1, 1], xy[i2, 0], xy[i2, 1])
    cx, cy = cx + xy[i0, 0], cy + xy[i0, 1]
    order = np.argsort((xy[:, 0] - cx) ** 2 + (xy[:, 1] - cy) ** 2)
    size = math.ceil(math.sqrt(count))
    previous, following = np.zeros(count, np.int64), np.zeros(count, np.int64)
    owned, hashed = np.zeros(count, np.int64), np.full(size, -1)
    stack = np.empty(512, np.int64)
    start = i0
    following[i0], previous[i2] = i1, i1
    following[i1], previous[i0] = i2, i2
    following[i2], previous[i1] = i0, i0
    owned[i0], owned[i1], owned[i2] = 0, 1, 2
    for i in (i0, i1, i2):
        hashed[_key(xy[i, 0] - cx, xy[i, 1] - cy, size)] = i
    _put(corner, half, 0, i0, i1, i2, -1, -1, -1)
    length = 3
    for k in range(count):
        i = order[k]
        x, y = xy[i, 0], xy[i, 1]
        if i in (i0, i1, i2):
            continue
        key, at = _key(x - cx, y - cy, size), 0
        for j in range(size):
            at = hashed[(key + j) % size]
            if at != -1 and at != following[at]:
                break
        begin = previous[at]
        e = begin
        while True:
            q = following[e]
            if _turn(x, y, xy[e, 0], xy[e, 1], xy[q, 0], xy[q, 1]) < 0:
                break
            e = q
            if e == begin:
                e = -1
                break
        if e == -1:
            continue  # it coincides with a point
        if (xy[e, 0] == x and xy[e, 1] == y) or (
            xy[following[e], 0] == x and xy[following[e], 1] == y
        ):
            continue
        _put(corner, half, length, e, i, following[e], -1, -1, owned[e])
        length += 3
        owned[i] = _flip(length - 1, xy, corner, half, stack, previous, owned, start)
        owned[e] = length - 3
        n = following[e]
        while True:  # forwards along the hull
            q = following[n]
            if _turn(x, y, xy[n, 0], xy[n, 1], xy[q, 0], xy[q, 1]) >= 0:
                break
            _put(corner, half, length, n, i, q, owned[i], -1, owned[n])
            length += 3
            owned[i] = _flip(length - 1, xy, corner, half, stack, previous, owned, start)
            following[n] = n  # no more on the hull
            n = q
        if e == begin:
            while True:  # backwards
                q = previous[e]
                if _turn(x, y, xy[q, 0], xy[q, 1], xy[e, 0], xy[e, 1]) >= 0:
                    break
                _put(corner, half, length, q, i, e, -1, owned[e], owned[q])
                length += 3
                _flip(length - 1, xy, corner, half, stack, previous, owned, start)
                owned[q] = length - 3
                following[e] = e
                e = q
        start = e
        previous[i] = e
        following[e], previous[n], following[i] = i, i, n
        hashed[_key(x - cx, y - cy, size)] = i
        hashed[_key(xy[e, 0] - cx, xy[e, 1] - cy, size)] = e
    return corner[:length], half[:length]


@njit(cache=True, nogil=True, error_model="numpy")
def _bounded(p, xy, others, count, reach):  # type: ignore[no-untyped-def]
    """Area of what lies within reach of p and nearer to it than to its neighbours.

    The circle is a polygon of the circle's area.
    """
    x, y = np.empty(_SIDES + count + 1), np.empty(_SIDES + count + 1)
    u, v = x.copy(), y.copy()
    wide = reach * math.sqrt(math.pi / (0.5 * _SIDES * math.sin(2 * math.pi / _SIDES)))
    sides = _SIDES
    for k in range(sides):
        x[k] = wide * math.cos(2 * math.pi * k / _SIDES)
        y[k] = wide * math.sin(2 * math.pi * k / _SIDES)
    for n in range(count):
        dx, dy = xy[others[n], 0] - xy[p, 0], xy[others[n], 1] - xy[p, 1]
        half = 0.5 * (dx * dx + dy * dy)
        if half == 0.0:
            continue
        kept = 0
        for k in range(sides):
            m = k + 1 if k + 1 < sides else 0
            here, there = half - x[k] * dx - y[k] * dy, half - x[m] * dx - y[m] * dy
            if here >= 0:
                u[kept], v[kept] = x[k], y[k]
                kept += 1
            if (here >= 0) != (there >= 0):
                share = here / (here - there)
                u[kept] = x[k] + share * (x[m] - x[k])
                v[kept] = y[k] + share * (y[m] - y[k])
                kept += 1
        sides = kept
        x[:sides], y[:sides] = u[:sides], v[:sides]
    area = 0.0
    for k in range(sides):
        m = k + 1 if k + 1 < sides else 0
        area += 0.5 * (x[k] * y[m] - x[m] * y[k])
    return area


@njit(cache=True, nogil=True, error_model="numpy")
def cells(xy, corner, half, first, neighbour, border):  # type: ignore[no-untyped-def]
    """(P,) areas of the Voronoi cells; border (P,) is set.

    neighbour[first[p] : first[p + 1]] are those of p in the graph. A cell at the border, open or
    reaching beyond the hull of the points, is bounded by a circle.
    """
    area = np.zeros(len(xy))
    hull = np.empty((len(xy) + 1, 3))
    lines = 0
    for e in range(len(corner)):
        if half[e] == -1:
            a, b = corner[e], corner[e + 1 if e % 3 < 2 else e - 2]
            border[a], border[b] = True, True
            c = corner[e - 1 if e % 3 else e + 2]
            dx, dy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
            side = 1.0 if dx * (xy[c, 1] - xy[a, 1]) - dy * (xy[c, 0] - xy[a, 0]) > 0 else -1.0
            hull[lines, 0], hull[lines, 1] = -dy * side, dx * side
            hull[lines, 2] = -(hull[lines, 0] * xy[a, 0] + hull[lines, 1] * xy[a, 1])
            lines += 1
    for t in range(0, len(corner), 3):
        a, b, c = corner[t], corner[t + 1], corner[t + 2]
        cx, cy = _centre(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1])
        out = not np.isfinite(cx)
        for n in range(lines):
            if out:
                break
            out = hull[n, 0] * (cx + xy[a, 0]) + hull[n, 1] * (cy + xy[a, 1]) + hull[n, 2] < 0
        if out:
            border[a], border[b], border[c] = True, True, True
            continue
        cx, cy = cx + xy[a, 0], cy + xy[a, 1]
        dx, dy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
        sign = 1.0 if dx * (xy[c, 1] - xy[a, 1]) - dy * (xy[c, 0] - xy[a, 0]) > 0 else -1.0
        for k in range(3):  # each edge gives both its ends the same triangle to the centre
            p, q = corner[t + k], corner[t + (k + 1) % 3]
            mx, my = (xy[p, 0] + xy[q, 0]) / 2, (xy[p, 1] + xy[q, 1]) / 2
            share = 0.5 * sign * ((mx - xy[p, 0]) * (cy - my) - (my - xy[p, 1]) * (cx - mx))
            area[p] += share
            area[q] += share
    for p in range(len(xy)):
        many = first[p + 1] - first[p]
        if border[p] and many:
            others = neighbour[first[p] : first[p + 1]]
            step = np.sqrt((xy[others, 0] - xy[p, 0]) ** 2 + (xy[others, 1] - xy[p, 1]) ** 2)
            step.sort()
            near = step[step > 0][:3]
            area[p] = _bounded(p, xy, others, many, near.mean()) if len(near) else 0.0
    return area
