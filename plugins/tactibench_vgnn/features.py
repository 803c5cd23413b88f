"""Tracked pins as numbers that a graph network reads."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactibench.markers import Tracks, pin_graph
from tactibench_vgnn.layout import PinLayout

Floats = npt.NDArray[np.float32]
Table = npt.NDArray[np.int64]

NODE = 5
"""Features of a pin: displacement in x and y, growth of its Voronoi cell and of its own picture,
and whether it was seen."""
NEAREST = 8
"""Neighbours that a pin listens to at most: in a Delaunay graph of pins it has 6 on average."""
NOBODY = -1
_LONGEST = 2.0
"""Edges beyond this multiple of the median are long."""


def node_features(tracks: Tracks, layout: PinLayout, graph: str) -> Floats:
    """(N, P, 5) features of the pins; (N, P, 5 + 8) with their neighbours where each frame has its
    own graph ("frame"): pin numbers, -1 for none.

    Displacement and growths are divided by their rms over the training frames; a growth is the
    logarithm of an area or a radius over that at rest.
    """
    count = len(tracks)
    features = np.zeros((count, len(layout.rest), NODE + NEAREST * (graph == "frame")), np.float32)
    areas = np.empty((count, len(layout.rest)))
    for frame, xy in enumerate(tracks.xy):
        found = pin_graph(xy)
        areas[frame] = found.area
        if graph == "frame":
            features[frame, :, NODE:] = neighbours(found.edges, xy)
    features[..., :2] = (tracks.xy - layout.rest) / layout.moved_px
    features[..., 2] = layout.growth(areas) / layout.grown
    known = np.where(tracks.seen, tracks.radius, np.nan)  # a fit to no light has shrunk
    features[..., 3] = layout.swelling(known) / layout.swollen
    features[..., 4] = tracks.seen
    return features


def neighbours(edges: Table, xy: npt.NDArray[np.float64]) -> Table:
    """(P, 8) pins at the other ends of the edges (E, 2) of each pin, nearest first; -1 for none.

    Long edges run along the hull between pins that are no neighbours on the skin; of them a pin
    keeps one where it has no other.
    """
    table = np.full((len(xy), NEAREST), NOBODY, dtype=np.int64)
    if not len(edges):
        return table
    both = np.concatenate([edges, edges[:, ::-1]])
    length = np.linalg.norm(xy[both[:, 0]] - xy[both[:, 1]], axis=1)
    order = np.lexsort((both[:, 1], length, both[:, 0]))
    here, there = both[order].T
    rank = np.arange(len(here)) - np.searchsorted(here, here)
    short = length[order] <= _LONGEST * np.median(length)
    kept = (rank < NEAREST) & (short | (rank == 0))
    table[here[kept], rank[kept]] = there[kept]
    return table
