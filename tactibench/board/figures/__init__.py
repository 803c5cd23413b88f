"""Pictures of a run, written as PNG. Importing this package loads matplotlib."""

from __future__ import annotations

from tactibench.board.figures.distance import distance_errors
from tactibench.board.figures.features import feature_maps
from tactibench.board.figures.frames import overlay
from tactibench.board.figures.relief import surfaces
from tactibench.board.figures.single import single_errors
from tactibench.board.figures.triple import triple_comparison

__all__ = [
    "distance_errors",
    "feature_maps",
    "overlay",
    "single_errors",
    "surfaces",
    "triple_comparison",
]
