"""Edges, cell areas and border of pins, compiled: triangulation and the cases without one."""

from __future__ import annotations

import numpy as np
from numba import njit

from tactibench.markers.delaunay import cells, triangulate


@njit(cache=True, nogil=True, error_model="numpy")
def _twins(xy, used, twin):  # type: ignore[no-untyped-def]
    """twin (P,): the nearest pin of the triangulation for those that are not in it."""
    for p in range(len(xy)):
        twin[p] = p
        if used[p]:
            continue
        best = np.inf
        for q in range(len(xy)):
            square = (xy[q, 0] - xy[p, 0]) ** 2 + (xy[q, 1] - xy[p, 1]) ** 2
            if used[q] and square < best:
                best, twin[p] = square, q


@njit(cache=True, nogil=True, error_model="numpy")
def _line(xy, keys, used):  # type: ignore[no-untyped-def]
    """Join pins on a line along it; of those that coincide the first is used."""
    pins = len(xy)
    wide = xy[:, 0].max() - xy[:, 0].min() >= xy[:, 1].max() - xy[:, 1].min()
    order = np.argsort(xy[:, 0 if wide else 1], kind="mergesort")
    count, last = 0, order[0]
    used[last] = True
    for k in range(1, pins):
        p = order[k]
        if xy[p, 0] == xy[last, 0] and xy[p, 1] == xy[last, 1]:
            continue
        keys[count] = min(p, last) * pins + max(p, last)
        count += 1
        used[p] = True
        last = p
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def network(xy):  # type: ignore[no-untyped-def]
    """edges (E, 2), area (P,), border (P,) of finite pins (P, 2)."""
    pins = len(xy)
    border = np.zeros(pins, np.bool_)
    if pins == 0:
        return np.empty((0, 2), np.int64), np.zeros(0), border
    corner, half = triangulate(xy)
    keys = np.empty(4 * pins + 8, np.int64)
    used, twin = np.zeros(pins, np.bool_), np.empty(pins, np.int64)
    count = 0
    for e in range(len(corner)):
        used[corner[e]] = True
        if half[e] < e:
            a, b = corner[e], corner[e + 1 if e % 3 < 2 else e - 2]
            keys[count] = min(a, b) * pins + max(a, b)
            count += 1
    if len(corner) == 0:
        count = _line(xy, keys, used)
        border[:] = True
    _twins(xy, used, twin)
    for p in range(pins):
        if twin[p] != p:
            keys[count] = min(p, twin[p]) * pins + max(p, twin[p])
            count += 1
    keys = np.sort(keys[:count])
    edges = np.empty((count, 2), np.int64)
    first = np.zeros(pins + 1, np.int64)
    for k in range(count):
        edges[k, 0], edges[k, 1] = keys[k] // pins, keys[k] % pins
        first[edges[k, 0] + 1] += 1
        first[edges[k, 1] + 1] += 1
    first = np.cumsum(first)
    neighbour, filled = np.empty(2 * count, np.int64), first[:-1].copy()
    for k in range(count):
        a, b = edges[k, 0], edges[k, 1]
        neighbour[filled[a]], neighbour[filled[b]] = b, a
        filled[a] += 1
        filled[b] += 1
    area = cells(xy, corner, half, first, neighbour, border)
    sharing = np.zeros(pins)
    for p in range(pins):
        sharing[twin[p]] += 1.0
    for p in range(pins):
        if twin[p] == p:
            area[p] /= max(sharing[p], 1.0)
    for p in range(pins):
        if twin[p] != p:
            area[p], border[p] = area[twin[p]], border[twin[p]]
    return edges, area, border
