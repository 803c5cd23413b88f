"""A clock that is set by hand and a sensor without mechanics, for tests of the emulators."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactibench import Frame, Pose, Scene, Sensor, UserError
from tactibench_tactip.emulators import Clock

DEEPEST_MM = 8.0


class HandClock(Clock):
    """Stands still until it is told otherwise. A monotonic nanosecond is one of the world."""

    def __init__(self) -> None:
        super().__init__(1.0)
        self.t = 0.0

    def now(self) -> float:
        return self.t

    def at(self, monotonic_ns: int) -> float:
        return monotonic_ns * 1e-9

    def go(self, seconds: float) -> float:
        self.t += seconds
        return self.t


class GraySensor(Sensor):
    """Nine bright squares on black; how bright they are tells how deep the press is, 20 levels a
    mm. Deeper than 8 mm is refused."""

    def __init__(self) -> None:
        self.pressed = 0

    def rest(self) -> Frame:
        return Frame(self._image(0.0), 0.0, Pose())

    def press(self, scene: Scene) -> Frame:
        if scene.pose.depth > DEEPEST_MM:
            raise UserError("too deep.")
        self.pressed += 1
        return Frame(self._image(scene.pose.depth), 0.0, scene.pose)

    def describe(self) -> dict[str, Any]:
        return {"sensor": "gray"}

    @staticmethod
    def _image(depth: float) -> np.ndarray:
        image = np.zeros((32, 32), dtype=np.uint8)
        for row in (4, 14, 24):
            for column in (4, 14, 24):
                image[row : row + 4, column : column + 4] = round(80 + 20 * depth)
        return image
