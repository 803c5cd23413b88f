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
"""Most neighbours of a pin: in a Delaunay graph of pins it has 6 on average."""
NO_PIN = -1
_LONGEST = 2.0
"""Edges beyond this multiple of the median are long."""


def node_features(tracks: Tracks, layout: PinLayout, graph: str) -> Floats:
    """Return the features (N, P, 5) of the pins of N frames.

    Displacement and growths are divided by their rms over the training frames; a growth is the
    logarithm of an area or a radius over that at rest.

    Args:
        tracks: Tracked pins of the frames.
        layout: Layout of the pins.
        graph: "frame": each frame has its own graph, and the features are (N, P, 5 + 8), with the
            numbers of the pin's neighbours, -1 for none; "rest": they have no such numbers.
    """
    count = len(tracks)
    features = np.zeros((count, len(layout.rest), NODE + NEAREST * (graph == "frame")), np.float32)
    areas = np.empty((count, len(layout.rest)))
    for frame, xy in enumerate(tracks.xy):
        voronoi = pin_graph(xy)
        areas[frame] = voronoi.area
        if graph == "frame":
            features[frame, :, NODE:] = neighbour_table(voronoi.edges, xy)
    features[..., :2] = (tracks.xy - layout.rest) / layout.moved_px
    features[..., 2] = layout.growth(areas) / layout.grown
    radius = np.where(tracks.seen, tracks.radius, np.nan)  # a fit to no light has shrunk
    features[..., 3] = layout.swelling(radius) / layout.swollen
    features[..., 4] = tracks.seen
    return features


def neighbour_table(edges: Table, xy: npt.NDArray[np.float64]) -> Table:
    """Return the neighbours (P, 8) of each pin, nearest first; -1 for none.

    Long edges run along the hull between pins that are no neighbours on the skin; a pin keeps one
    of them where it has no other edge.

    Args:
        edges: (E, 2) numbers of the pins that an edge joins.
        xy: (P, 2) places of the pins, px.
    """
    table = np.full((len(xy), NEAREST), NO_PIN, dtype=np.int64)
    if not len(edges):
        return table
    directed = np.concatenate([edges, edges[:, ::-1]])
    length = np.linalg.norm(xy[directed[:, 0]] - xy[directed[:, 1]], axis=1)
    order = np.lexsort((directed[:, 1], length, directed[:, 0]))
    pin, neighbour = directed[order].T
    rank = np.arange(len(pin)) - np.searchsorted(pin, pin)
    short = length[order] <= _LONGEST * np.median(length)
    listed = (rank < NEAREST) & (short | (rank == 0))
    table[pin[listed], rank[listed]] = neighbour[listed]
    return table
