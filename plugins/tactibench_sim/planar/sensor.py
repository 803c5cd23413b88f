"""The simulated planar sensor: a flat gel pad, a square grid of markers, a camera below."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import Grid, Scene, SensorContext, __version__
from tactibench_sim.contact import Tips
from tactibench_sim.instances import Spread, lost_pins, perturbed
from tactibench_sim.limit import covariance, deviations
from tactibench_sim.nuisance import NUISANCES
from tactibench_sim.parameters import optics_from
from tactibench_sim.planar import table as tables
from tactibench_sim.planar.contact import pad_tips
from tactibench_sim.planar.field import PadMechanics
from tactibench_sim.planar.preset import PLANAR_GRID
from tactibench_sim.render import Renderer
from tactibench_sim.rendered import FRAMES_PER_SECOND, RenderedSensor

Array = npt.NDArray[np.float64]
SPREAD = Spread(gel_mm=0.0)
"""The pad's thickness is that of its table, in every instance."""


class PlanarGrid(RenderedSensor):
    """A flat pad bonded to a window. The origin is the middle of its surface, z out of the pad."""

    preset = PLANAR_GRID
    dome_radius_mm = math.inf
    nuisances = NUISANCES

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
        """optical: parameters of ``parameters.optics_from``; what is missing is the preset's."""
        self._tables = tables.read(Path(table)) if table else tables.shipped()
        self.mechanics = PadMechanics(self._tables, tier)
        self.deepest_mm = self._tables.deepest
        gel = replace(self.preset.optics, gel_mm=self._tables.thickness)
        self.instance = instance
        self.optics, _ = perturbed(optics_from(gel, optical), 1.0, instance, SPREAD)
        count = self.preset.markers**2
        self.lost = lost_pins(count, self.optics.pin_loss, instance)
        self.markers = square_grid(self.preset.markers, self.preset.pitch_mm)[~self.lost]
        renderer = Renderer(self.optics, self.optics.camera_distance_mm)
        super().__init__(context, renderer, self._displaced(_UNTOUCHED)[0], threads)

    def _displaced(self, tips: Tips) -> Array:
        """(S, P, 3) markers, mm. Raises UserError as ``press``."""
        out = self.mechanics.markers(self.mechanics.loads(tips), self.markers)
        out[..., :2] += self.markers
        out[..., 2] -= self._tables.marker_depth
        return out

    def _tips(self, scenes: Sequence[Scene]) -> Tips:
        return pad_tips(scenes, self.preset.reach_mm)

    def points(self, scenes: Sequence[Scene]) -> Array:
        return self._displaced(self._tips(scenes))

    def clean(self, tips: Tips) -> Array:
        """(S, size, size) grey levels without noise. Raises UserError as ``press``."""
        return self.renderer.clean(self._displaced(tips))

    def surface(self, scene: Scene, grid: Grid) -> Array:
        """(H, W) mm into the pad of the surface's points that lie above the cells at rest."""
        x, y = (axis.ravel() for axis in np.meshgrid(*grid.axes()))
        loads = self.mechanics.loads(self._tips([scene]))
        into: Array = -self.mechanics.surface(loads, np.stack([x, y], axis=1))[0, :, 2]
        return into.reshape(grid.shape)

    def covariance(self, scene: Scene, nuisances: Sequence[str] = ()) -> Array:
        """(3 K, 3 K) mm^2 Cramer-Rao covariance of x, y, depth of every true contact.

        Of the grey frame that models see; of output "bw" it holds, but cannot be reached.
        """
        return covariance(self._tips([scene]), self.clean, self.renderer.variance, nuisances)

    def bound(self, scene: Scene) -> Array:
        """(K, 3) Cramer-Rao standard deviations of x, y, depth of every true contact, mm."""
        return deviations(self.covariance(scene))

    def describe(self) -> dict[str, Any]:
        """Everything that determines the frames, but the seed."""
        return {
            "sensor": self.preset.name,
            "plugin": f"tactibench_sim {__version__}",
            "tier": self.mechanics.tier,
            "instance": self.instance,
            "markers": self.preset.markers**2,
            "lost_markers": np.flatnonzero(self.lost).tolist(),
            "pitch_mm": self.preset.pitch_mm,
            "optics": asdict(self.optics),
            "surface": "flat",
            "deepest_mm": self.deepest_mm,
            "reach_mm": self.preset.reach_mm,
            "tables": {**self._tables.parameters, "sha256": self._tables.digest},
            "frames_per_second": FRAMES_PER_SECOND,
        }


_UNTOUCHED = Tips(np.zeros((1, 1, 2)), np.full((1, 1), -np.inf), np.full(1, 3.0))


def square_grid(side: int, pitch: float) -> Array:
    """(side^2, 2) mm, row by row along y, its middle at the origin."""
    steps = (np.arange(side) - (side - 1) / 2) * pitch
    x, y = np.meshgrid(steps, steps)
    return np.stack([x.ravel(), y.ravel()], axis=1)
