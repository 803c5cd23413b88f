"""The sensors that ship, as frozen records."""

from __future__ import annotations

from dataclasses import dataclass

from tactibench_sim.optics import Optics


@dataclass(frozen=True)
class Preset:
    """A dome with pins and a camera. pin_length_mm: 2, about that of public TacTips."""

    name: str
    pins: int
    optics: Optics
    pin_length_mm: float = 2.0


TACTIP_127 = Preset("tactip-127", 127, Optics(marker_radius_mm=0.36))
"""As the real 127-pin sensor of the Tac-VGNN data: with this marker radius a thresholded rest frame
has discs of the real frame's median area. Glare, when it is switched on: six arcs."""

TACTIP_331 = Preset(
    "tactip-331", 331, Optics(marker_radius_mm=0.47, glare_width=0.014, glare_arc_deg=80.0)
)
"""As the real 331-pin sensor, marker radius likewise. Glare: a closed ring, thick at the LEDs."""
