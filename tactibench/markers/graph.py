"""The Voronoi graph of a frame's pins: which pins are neighbours, and how large their cells are.

The triangulation is Qhull's (scipy). The areas of the cells are summed up from its triangles: for
each edge of a triangle, both ends get the area of the same triangle, from the end to the edge's
middle to the circumcentre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial import Delaunay, QhullError

from tactibench.errors import UserError

Array = npt.NDArray[np.float64]
Edges = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_SIDES = 48
"""Sides of the polygon that stands for the circle around a cell at the border."""
_ON_A_LINE = 1e-24
"""Squared sine below which three pins have no circumcentre."""


@dataclass(frozen=True, eq=False)
class PinGraph:
    """The neighbours of pins and the room that each pin has.

    A cell is at the border where it is open or reaches beyond the convex hull of the pins. Its area
    is that of its part within the mean distance of its pin's three nearest neighbours.

    Attributes:
        edges: (E, 2) pins, lower number first, sorted.
        area: (P,) px^2 of the Voronoi cells.
        border: (P,) whether the cell is at the border.
    """

    edges: Edges
    area: Array
    border: Flags


def pin_graph(xy: Array) -> PinGraph:
    """Return the Delaunay edges of pins (P, 2) px and the areas of their Voronoi cells.

    Pins that coincide are joined by an edge and share one cell equally.

    Raises:
        UserError: The pins lie on a line, or are fewer than three.
    """
    corners, hull = _triangulate(xy)
    pairs = corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    twin = _nearest_corner(xy, corners)
    doubled = np.flatnonzero(twin != np.arange(len(xy)))
    pairs = np.concatenate([pairs, np.stack([doubled, twin[doubled]], axis=1)])
    number = np.unique(pairs.min(axis=1) * len(xy) + pairs.max(axis=1))
    edges = np.stack(np.divmod(number, len(xy)), axis=1)
    both_ways = np.sort(np.concatenate([number, edges[:, 1] * len(xy) + edges[:, 0]]))
    pin, neighbour = np.divmod(both_ways, len(xy))
    first = np.searchsorted(pin, np.arange(len(xy) + 1))
    border = np.zeros(len(xy), dtype=np.bool_)
    area = _cells(np.ascontiguousarray(xy), corners, hull, first, neighbour, border)
    area /= np.bincount(twin, minlength=len(xy)).clip(1)
    area[doubled], border[doubled] = area[twin[doubled]], border[twin[doubled]]
    return PinGraph(edges, area, border)


def _triangulate(xy: Array) -> tuple[Edges, Edges]:
    """Return the corners (T, 3) of all triangles and (H, 3) of those with a side on the hull.

    In the second array the two ends of the side on the hull come first.
    """
    try:
        # Centred: Qhull would round differences of large coordinates away.
        triangulation = Delaunay(xy - xy.mean(axis=0))
    except QhullError:
        raise UserError(
            f"the {len(xy)} pins lie on a line or are fewer than three, so that they have no "
            "Voronoi cells; a model with a graph of pins needs a rest frame with all pins."
        ) from None
    corners = triangulation.simplices.astype(np.int64)
    triangle, opposite = np.nonzero(triangulation.neighbors < 0)
    turn = (opposite[:, None] + [1, 2, 0]) % 3
    return corners, corners[triangle[:, None], turn]


def _nearest_corner(xy: Array, corners: Edges) -> Edges:
    """Return for every pin (P,) itself, or where two pins coincide the one that has a triangle."""
    nearest = np.arange(len(xy))
    left_out = np.flatnonzero(np.bincount(corners.ravel(), minlength=len(xy)) == 0)
    if len(left_out):
        used = np.unique(corners)
        away = np.square(xy[left_out, None] - xy[used]).sum(axis=-1)
        nearest[left_out] = used[away.argmin(axis=1)]
    return nearest


@njit(cache=True, nogil=True, error_model="numpy")
def _cells(xy, corners, hull, first, neighbour, border):  # type: ignore[no-untyped-def]
    """Return the areas of the Voronoi cells, (P,) px^2.

    A cell at the border is open or reaches beyond the hull of the pins. It is bounded by a circle
    whose radius is the mean distance of the pin's three nearest neighbours.

    Args:
        xy: (P, 2) px, the pins.
        corners: (T, 3) pins of every triangle.
        hull: (H, 3) pins of the triangles with a side on the hull, that side's two ends first.
        first: (P + 1,), so that neighbour[first[p] : first[p + 1]] are the neighbours of pin p.
        neighbour: Neighbours of all pins, pin after pin.
        border: (P,), set to True for cells at the border.
    """
    area = np.zeros(len(xy))
    lines = np.empty((len(hull), 3))
    for n in range(len(hull)):
        a, b, c = hull[n]
        border[a], border[b] = True, True
        side = _side(xy, a, b, c)
        lines[n, 0] = (xy[a, 1] - xy[b, 1]) * side
        lines[n, 1] = (xy[b, 0] - xy[a, 0]) * side
        lines[n, 2] = -(lines[n, 0] * xy[a, 0] + lines[n, 1] * xy[a, 1])
    for t in range(len(corners)):
        a, b, c = corners[t]
        x, y = _circumcentre(xy, a, b, c)
        beyond = not np.isfinite(x)
        for n in range(len(lines)):
            beyond |= lines[n, 0] * x + lines[n, 1] * y + lines[n, 2] < 0
        if beyond:
            border[a], border[b], border[c] = True, True, True
            continue
        side = _side(xy, a, b, c)
        for k in range(3):
            p, q = corners[t, k], corners[t, (k + 1) % 3]
            mx, my = (xy[p, 0] + xy[q, 0]) / 2, (xy[p, 1] + xy[q, 1]) / 2
            share = 0.5 * side * ((mx - xy[p, 0]) * (y - my) - (my - xy[p, 1]) * (x - mx))
            area[p] += share
            area[q] += share
    for p in np.flatnonzero(border):
        others = neighbour[first[p] : first[p + 1]]
        step = np.sqrt((xy[others, 0] - xy[p, 0]) ** 2 + (xy[others, 1] - xy[p, 1]) ** 2)
        step.sort()
        near = step[step > 0][:3]
        area[p] = _clipped_circle(xy, p, others, near.mean()) if len(near) else 0.0
    return area


@njit(cache=True, nogil=True, error_model="numpy")
def _side(xy, a, b, c):  # type: ignore[no-untyped-def]
    """Return 1 where pin c lies to the left of the way from a to b, y taken upwards, else -1."""
    dx, dy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
    return 1.0 if dx * (xy[c, 1] - xy[a, 1]) - dy * (xy[c, 0] - xy[a, 0]) > 0 else -1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _circumcentre(xy, a, b, c):  # type: ignore[no-untyped-def]
    """Return x and y of the centre of the circle through three pins; inf for pins on a line."""
    dx, dy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
    ex, ey = xy[c, 0] - xy[a, 0], xy[c, 1] - xy[a, 1]
    first, second = dx * dx + dy * dy, ex * ex + ey * ey
    area = dx * ey - dy * ex
    if area * area <= _ON_A_LINE * first * second:
        return np.inf, np.inf
    x, y = (ey * first - dy * second) * 0.5 / area, (dx * second - ex * first) * 0.5 / area
    return x + xy[a, 0], y + xy[a, 1]


@njit(cache=True, nogil=True, error_model="numpy")
def _clipped_circle(xy, p, others, reach):  # type: ignore[no-untyped-def]
    """Return the area of the places within ``reach`` of pin p that are nearer to it than to others.

    A polygon of the circle's area stands for the circle. It is clipped by one bisector after the
    other.
    """
    count = len(others)
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
        corners = 0
        for k in range(sides):
            m = k + 1 if k + 1 < sides else 0
            inside, after = half - x[k] * dx - y[k] * dy, half - x[m] * dx - y[m] * dy
            if inside >= 0:
                u[corners], v[corners] = x[k], y[k]
                corners += 1
            if (inside >= 0) != (after >= 0):
                share = inside / (inside - after)
                u[corners] = x[k] + share * (x[m] - x[k])
                v[corners] = y[k] + share * (y[m] - y[k])
                corners += 1
        sides = corners
        x[:sides], y[:sides] = u[:sides], v[:sides]
    area = 0.0
    for k in range(sides):
        m = k + 1 if k + 1 < sides else 0
        area += 0.5 * (x[k] * y[m] - x[m] * y[k])
    return area
