"""The simulated TacTip as a sensor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench import Frame, Grid, Pose, Scene, SensorContext, UserError, __version__
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim import limit
from tactibench_sim import table as tables
from tactibench_sim.contact import Tips, tips_of
from tactibench_sim.field import Mechanics
from tactibench_sim.noise import Noise, to_uint8
from tactibench_sim.optics import Camera
from tactibench_sim.pins import layout

Array = npt.NDArray[np.float64]
BATCH = 64
FRAMES_PER_SECOND = 30.0
"""Nominal rate behind the timestamps; a simulated sensor has no clock."""


class SimulatedTacTip:
    """A skin-on-gel dome with pins; single-contact fields from finite elements.

    Frames depend on the scene, the parameters and, for their noise, on the seed and the number of
    presses since the sensor was opened; not on how presses are grouped.
    """

    pins = 0

    def __init__(
        self,
        context: SensorContext,
        *,
        tier: str = "coupled",
        size: int = 128,
        noise: bool = True,
        read_noise: float = Noise.read,
        full_well: float = Noise.full_well,
        brightness: float = Camera.brightness,
        background: float = Camera.background,
        edge: float = Camera.edge_px,
        pin_length: float = 2.0,
        pin_radius: float = Camera.pin_radius_mm,
        camera_distance: float = 55.0,
        focal: float = Camera.focal,
        table: str = "",
    ) -> None:
        self._seed = context.seed
        self._tables = tables.read(Path(table)) if table else tables.shipped()
        self.mechanics = Mechanics(self._tables, tier)
        self.camera = Camera(
            size, camera_distance - DOME_RADIUS_MM, focal, pin_radius, edge, background, brightness
        )
        self.noise = Noise(noise, read_noise, full_well)
        self.pin_length = pin_length
        self.directions = layout(self.pins)
        untouched = Tips(np.zeros((1, 1, 2)), np.full((1, 1), -np.inf), np.full(1, np.inf))
        self._rest = to_uint8(self.clean(untouched)[0].astype(np.float32))
        self._rest.setflags(write=False)
        self._count = 0

    def __enter__(self) -> Self:
        self._count = 0
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Nothing is held open."""

    def clean(self, tips: Tips) -> Array:
        """(S, size, size) grey levels without noise. Raises UserError as ``press``."""
        loads = self.mechanics.loads(tips)
        return self.camera.render(self.mechanics.pin_tips(loads, self.directions, self.pin_length))

    def rest(self) -> Frame:
        """The undeformed sensor, without noise."""
        return Frame(self._rest, self._count / FRAMES_PER_SECOND, Pose(), self._rest)

    def press(self, scene: Scene) -> Frame:
        """Press once. Raises UserError for a scene the tables do not cover."""
        return self._expose(scene, self.clean(tips_of([scene]))[0].astype(np.float32))

    def press_many(self, scenes: Iterable[Scene]) -> Iterator[Frame]:
        """Press in order; batches are computed ahead, their noise when a frame is taken."""
        source = iter(scenes)
        while batch := list(islice(source, BATCH)):
            try:
                images = self.clean(tips_of(batch)).astype(np.float32)
            except UserError:  # hand out what precedes the bad scene, then name it
                for scene in batch:
                    yield self.press(scene)
                raise
            for scene, image in zip(batch, images, strict=True):
                yield self._expose(scene, image)

    def _expose(self, scene: Scene, clean: npt.NDArray[np.float32]) -> Frame:
        image = self.noise.expose(clean, self._seed, self._count)
        self._count += 1
        return Frame(image, self._count / FRAMES_PER_SECOND, scene.pose, self._rest)

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

    def bound(self, scene: Scene) -> Array:
        """(K, 3) Cramer-Rao standard deviations of x, y, depth of every true contact, mm."""
        return limit.bound(tips_of([scene]), self.clean, self.noise.variance)

    def describe(self) -> dict[str, Any]:
        """Everything that determines the frames, but the seed."""
        return {
            "sensor": f"tactip-{self.pins}",
            "plugin": f"tactibench_sim {__version__}",
            "tier": self.mechanics.tier,
            "pins": self.pins,
            "pin_length_mm": self.pin_length,
            "camera": asdict(self.camera),
            "noise": asdict(self.noise),
            "dome_radius_mm": DOME_RADIUS_MM,
            "tables": {**self._tables.parameters, "sha256": self._tables.digest},
            "frames_per_second": FRAMES_PER_SECOND,
        }


class TacTip127(SimulatedTacTip):
    """127 pins, hexagonal."""

    pins = 127


class TacTip331(SimulatedTacTip):
    """331 pins in ten rings."""

    pins = 331
