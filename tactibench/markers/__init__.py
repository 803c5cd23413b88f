"""Markers (pins) of a tactile frame: found in the picture, matched to the undeformed layout."""

from tactibench.markers.detect import Markers, detect
from tactibench.markers.match import match

__all__ = ["Markers", "detect", "match"]
