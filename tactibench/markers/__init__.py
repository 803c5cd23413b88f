"""Markers (pins) of a tactile frame: found in the picture, followed from the undeformed layout."""

from tactibench.markers.common import carried, common_view, lattice
from tactibench.markers.graph import PinGraph, pin_graph
from tactibench.markers.track import Tracker, Tracks, rest_layout

__all__ = [
    "PinGraph",
    "Tracker",
    "Tracks",
    "carried",
    "common_view",
    "lattice",
    "pin_graph",
    "rest_layout",
]
