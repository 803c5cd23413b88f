"""Markers (pins) of a tactile frame: found in the picture, matched to the undeformed layout."""

from tactibench.markers.detect import Markers, detect
from tactibench.markers.graph import PinGraph, pin_graph
from tactibench.markers.match import match
from tactibench.markers.track import Tracker, Tracks, rest_layout

__all__ = [
    "Markers",
    "PinGraph",
    "Tracker",
    "Tracks",
    "detect",
    "match",
    "pin_graph",
    "rest_layout",
]
