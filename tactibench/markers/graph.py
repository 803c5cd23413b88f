"""The Voronoi graph of a frame's pins: who borders on whom, and how much room each has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PinGraph:
    """edges: (E, 2), lower pin first, sorted; area: (P,) px^2 of the Voronoi cells; border: (P,).

    A cell is at the border where it is open or reaches beyond the convex hull of the pins. Its area
    is that of its part within the mean distance of its pin's three nearest neighbours.
    """

    edges: npt.NDArray[np.int64]
    area: Array
    border: npt.NDArray[np.bool_]


def pin_graph(xy: Array) -> PinGraph:
    """Delaunay edges of pins (P, 2) px and the areas of their Voronoi cells, any P.

    Pins that coincide are joined by an edge and share one cell equally. Pins on one line are joined
    along it, all of them at the border. A pin with NaN has no edge and area 0, as has a single one.
    Raises UserError for any other shape.
    """
    from tactibench.markers.network import network

    xy = np.asarray(xy, dtype=np.float64)
    if xy.ndim != 2 or xy.shape[1] != 2:
        raise UserError(f"the pins have shape {xy.shape}; a graph is made of pins (P, 2).")
    there = np.flatnonzero(np.isfinite(xy).all(axis=1))
    if len(there) == len(xy):
        return PinGraph(*network(np.ascontiguousarray(xy)))
    edges, area, border = network(xy[there])
    wide, open_ = np.zeros(len(xy)), np.zeros(len(xy), dtype=np.bool_)
    wide[there], open_[there] = area, border
    return PinGraph(there[edges], wide, open_)
