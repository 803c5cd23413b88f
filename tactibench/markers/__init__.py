"""Markers (pins) of a tactile frame: found in the picture, followed from the undeformed layout."""

from tactibench.markers.graph import PinGraph, pin_graph
from tactibench.markers.track import Tracker, Tracks, rest_layout

__all__ = [
    "PinGraph",
    "Tracker",
    "Tracks",
    "pin_graph",
    "rest_layout",
]
