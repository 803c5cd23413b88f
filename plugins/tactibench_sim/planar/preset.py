"""The planar sensor that ships, as a frozen record."""

from __future__ import annotations

from dataclasses import dataclass

from tactibench_sim.optics import Optics


@dataclass(frozen=True)
class PlanarPreset:
    """A square marker grid in a flat pad, and a camera. The pad itself is in the table file.

    markers: a side, the grid's middle under the origin. pitch_mm: 1.5; simulations of a GelSight
    Mini have 1.33 and 1.48 mm (FOTS, ``params.py``: 26 and 29 px at 19.58 px/mm). reach_mm: how far
    from the middle, in x and in y, a tip may press. The pad is meant to be 40 mm wide, its fields
    do not know its edge: a free edge 10 mm off all around moves the surface by 0.01 mm within 5 mm
    of a tip of 3 mm at 1 mm depth, and by 0.02 mm beside the edge (finite elements).
    """

    name: str
    optics: Optics
    markers: int = 14
    pitch_mm: float = 1.5
    reach_mm: float = 10.0


PLANAR_GRID = PlanarPreset(
    "planar-grid",
    Optics(camera_distance_mm=30.0, focal=1.15, gel_mm=5.0, marker_radius_mm=0.3),
)
"""Camera 30 mm from the surface (28.5 mm in the GelSight Mini of the simulator TacEx, with 4.5 mm
of gel); the focal length shows the grid and 1.5 mm around it (assumed). Markers of 0.6 mm, white in
a dark gel like the pins of a TacTip (assumed; a GelSight's are dark in a lit one)."""
