"""The simulated TacTip as a sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import Grid, Scene, SensorContext, __version__
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim import domes
from tactibench_sim import table as tables
from tactibench_sim.auto import DEFAULT_TOLERANCE_MM, AutoMechanics
from tactibench_sim.contact import Tips, tips_of
from tactibench_sim.instances import lost_pins, perturbed
from tactibench_sim.limit import covariance, deviations
from tactibench_sim.noise import Noise
from tactibench_sim.nuisance import NUISANCES
from tactibench_sim.parameters import optics_from
from tactibench_sim.pins import layout
from tactibench_sim.presets import TACTIP_127, TACTIP_331, Preset
from tactibench_sim.render import Renderer
from tactibench_sim.rendered import FRAMES_PER_SECOND, RenderedSensor
from tactibench_sim.tiers import mechanics_for

Array = npt.NDArray[np.float64]


class SimulatedTacTip(RenderedSensor):
    """A skin-on-gel dome with pins; single-contact fields from finite elements."""

    preset: Preset
    nuisances = NUISANCES

    def __init__(
        self,
        context: SensorContext,
        *,
        tier: str = "coupled",
        tolerance: float = DEFAULT_TOLERANCE_MM,
        allow_fem: bool = False,
        table: str = "",
        instance: int = 0,
        pin_length: float | None = None,
        threads: int | None = None,
        **optical: Any,
    ) -> None:
        """optical: parameters of ``parameters.optics_from``; what is missing is the preset's."""
        self._tables = (
            tables.read(Path(table)) if table else domes.of_instance(tables.shipped(), instance)
        )
        self.mechanics = mechanics_for(tier, self._tables, tolerance, allow_fem)
        length = self.preset.pin_length_mm if pin_length is None else pin_length
        nominal = optics_from(self.preset.optics, optical)
        self.instance = instance
        self.optics, self.pin_length = perturbed(nominal, length, instance)
        self.lost = lost_pins(self.preset.pins, self.optics.pin_loss, instance)
        self.directions = layout(self.preset.pins)[~self.lost]
        renderer = Renderer(self.optics, self.optics.camera_distance_mm - DOME_RADIUS_MM)
        super().__init__(context, renderer, self.tips(_UNTOUCHED)[0], threads)

    @property
    def noise(self) -> Noise:
        return self.optics.noise

    def tips(self, tips: Tips) -> Array:
        """(S, P, 3) pin tips from the dome's centre, mm. Raises UserError as ``press``."""
        loads = self.mechanics.loads(tips)
        found: Array = self.mechanics.pin_tips(loads, self.directions, self.pin_length)
        return found

    def points(self, scenes: Sequence[Scene]) -> Array:
        return self.tips(tips_of(scenes))

    def clean(self, tips: Tips) -> Array:
        """(S, size, size) grey levels without noise. Raises UserError as ``press``."""
        return self.renderer.clean(self.tips(tips))

    def surface(self, scene: Scene, grid: Grid) -> Array:
        """(H, W) inward displacement of the outer skin, mm; zero beside the dome."""
        x, y = (axis.ravel() for axis in np.meshgrid(*grid.axes()))
        square = x**2 + y**2
        above = square < DOME_RADIUS_MM**2
        z = np.sqrt(DOME_RADIUS_MM**2 - square[above])
        directions = np.stack([x[above], y[above], z], axis=1) / DOME_RADIUS_MM
        out = np.zeros(len(x))
        out[above] = self.mechanics.skin(self.mechanics.loads(tips_of([scene])), directions)[0]
        return out.reshape(grid.shape)

    def covariance(self, scene: Scene, nuisances: Sequence[str] = ()) -> Array:
        """(3 K, 3 K) mm^2 Cramer-Rao covariance of x, y, depth of every true contact.

        Of the grey frame that models see; of output "bw" it holds, but cannot be reached.
        """
        return covariance(tips_of([scene]), self.clean, self.renderer.variance, nuisances)

    def bound(self, scene: Scene) -> Array:
        """(K, 3) Cramer-Rao standard deviations of x, y, depth of every true contact, mm."""
        return deviations(self.covariance(scene))

    def scene_counts(self, scenes: Sequence[Scene]) -> dict[str, int]:
        """Scenes by the tier that tier ``auto`` takes for them; empty for the other tiers."""
        if not isinstance(self.mechanics, AutoMechanics) or not scenes:
            return {}
        return self.mechanics.taken(tips_of(scenes))

    def describe(self) -> dict[str, Any]:
        """Everything that determines the frames, but the seed."""
        return {
            "sensor": self.preset.name,
            "plugin": f"tactibench_sim {__version__}",
            "tier": self.mechanics.tier,
            **({"tolerance_mm": self.mechanics.tolerance} if self.mechanics.tier == "auto" else {}),
            "instance": self.instance,
            "pins": self.preset.pins,
            "lost_pins": np.flatnonzero(self.lost).tolist(),
            "pin_length_mm": self.pin_length,
            "optics": asdict(self.optics),
            "dome_radius_mm": DOME_RADIUS_MM,
            "tables": {**self._tables.parameters, "sha256": self._tables.digest},
            "frames_per_second": FRAMES_PER_SECOND,
        }


_UNTOUCHED = Tips(np.zeros((1, 1, 2)), np.full((1, 1), -np.inf), np.full(1, np.inf))


class TacTip127(SimulatedTacTip):
    """127 pins, hexagonal."""

    preset = TACTIP_127


class TacTip331(SimulatedTacTip):
    """331 pins in ten rings."""

    preset = TACTIP_331
