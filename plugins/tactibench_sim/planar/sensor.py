"""The simulated planar sensor: a flat gel pad, a square grid of markers, a camera below."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import Grid, Scene, SensorContext, __version__
from tactibench_sim.instances import Spread, lost_pins, perturb
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.optics.camera import Optics, optics_from
from tactibench_sim.optics.renderer import Renderer
from tactibench_sim.planar import mechanics
from tactibench_sim.rendered_sensor import FRAMES_PER_SECOND, BoundedSensor

Array = npt.NDArray[np.float64]
SPREAD = Spread(gel_mm=0.0)
"""Ranges of the instances; the pad's thickness is that of its table in all of them."""


@dataclass(frozen=True)
class PlanarPreset:
    """A square marker grid in a flat pad, and a camera. The pad itself is in the table file.

    Attributes:
        name: Name of the sensor.
        optics: The camera.
        markers: Number of markers on a side; the grid's middle is under the origin.
        pitch_mm: Distance of neighbouring markers. Simulations of a GelSight Mini have 1.33 and
            1.48 mm (FOTS, ``params.py``: 26 and 29 px at 19.58 px/mm).
        reach_mm: Distance from the middle, in x and in y, within which a tip may press. The pad is
            meant to be 40 mm wide, and its fields do not include its edge: a free edge 10 mm off
            all around moves the surface by 0.01 mm within 5 mm of a tip of 3 mm at 1 mm depth, and
            by 0.02 mm beside the edge (finite elements).
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


class PlanarGrid(BoundedSensor):
    """A flat pad bonded to a window. The origin is the middle of its surface, z out of the pad."""

    preset = PLANAR_GRID
    dome_radius_mm = math.inf

    def __init__(
        self,
        context: SensorContext,
        *,
        tier: str = "coupled",
        table: str = "",
        instance: int = 0,
        threads: int | None = None,
        **optical: Any,
    ) -> None:
        """Build the pad, its markers and its camera.

        Args:
            context: The seed of the noise.
            tier: How contacts share the load.
            table: Path of a file of single-tip fields; "": the one that ships.
            instance: Number of the sensor instance; 0: the nominal one.
            threads: Number of threads of ``press_many``; None: ``thread_count()``.
            **optical: Parameters of ``optics_from``; the others are the preset's.
        """
        self._tables = mechanics.read(Path(table)) if table else mechanics.shipped()
        self.mechanics = mechanics.PadMechanics(self._tables, tier)
        self.deepest_mm = self._tables.deepest
        gel = replace(self.preset.optics, gel_mm=self._tables.thickness)
        self.instance = instance
        self.optics, _ = perturb(optics_from(gel, optical), 1.0, instance, SPREAD)
        count = self.preset.markers**2
        self.lost = lost_pins(count, self.optics.pin_loss, instance)
        self.markers = square_grid(self.preset.markers, self.preset.pitch_mm)[~self.lost]
        renderer = Renderer(self.optics, self.optics.camera_distance_mm)
        height = np.full(len(self.markers), -self._tables.marker_depth)
        super().__init__(context, renderer, np.column_stack([self.markers, height]), threads)

    def indenter_tips(self, scenes: Sequence[Scene]) -> Tips:
        """Return the tips of scenes on the pad (``mechanics.pad_tips``)."""
        return mechanics.pad_tips(scenes, self.preset.reach_mm)

    def places(self, tips: Tips) -> Array:
        """Return the (S, P, 3) places of the markers, mm."""
        out = self.mechanics.markers(self.mechanics.loads(tips), self.markers)
        out[..., :2] += self.markers
        out[..., 2] -= self._tables.marker_depth
        return out

    def surface(self, scene: Scene, grid: Grid) -> Array:
        """Return the (H, W) displacement into the pad, mm, of the surface above cells at rest."""
        x, y = (axis.ravel() for axis in np.meshgrid(*grid.axes()))
        loads = self.mechanics.loads(self.indenter_tips([scene]))
        into: Array = -self.mechanics.surface(loads, np.stack([x, y], axis=1))[0, :, 2]
        return into.reshape(grid.shape)

    def describe(self) -> dict[str, Any]:
        """Return everything that determines the frames, except the seed."""
        return {
            "sensor": self.preset.name,
            "plugin": f"tactibench_sim {__version__}",
            "tier": self.mechanics.tier,
            "instance": self.instance,
            "markers": self.preset.markers**2,
            "lost_markers": np.flatnonzero(self.lost).tolist(),
            "pitch_mm": self.preset.pitch_mm,
            "optics": self.optics.describe(),
            "surface": "flat",
            "deepest_mm": self.deepest_mm,
            "reach_mm": self.preset.reach_mm,
            "tables": {**self._tables.parameters, "sha256": self._tables.digest},
            "frames_per_second": FRAMES_PER_SECOND,
        }


def square_grid(side: int, pitch: float) -> Array:
    """Return the (side^2, 2) places of a grid, mm, row by row along y, its middle at the origin."""
    steps = (np.arange(side) - (side - 1) / 2) * pitch
    x, y = np.meshgrid(steps, steps)
    return np.stack([x.ravel(), y.ravel()], axis=1)
