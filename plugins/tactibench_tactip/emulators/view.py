"""What the sensor looks like when it is pressed; made once for every press."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from threading import Lock

import numpy as np
import numpy.typing as npt

from tactibench import Scene, Sensor, UserError

Image = npt.NDArray[np.uint8]
KEPT = 64
FINEST_MM = 1e-3
TRIES = 60


class View:
    """Images of scenes by a sensor, the latest 64 kept. Thread-safe, but one is made at a time."""

    def __init__(self, sensor: Sensor) -> None:
        self.sensor = sensor
        self._lock = Lock()
        self._kept: OrderedDict[Scene, Image] = OrderedDict()
        self.rest = _fixed(sensor.rest().image)

    def image(self, scene: Scene | None) -> Image:
        """(H, W) or (H, W, 3), read-only; None: at rest. Poses are rounded to a micrometre."""
        if scene is None:
            return self.rest
        key = _rounded(scene)
        with self._lock:
            if key not in self._kept:
                self._kept[key] = self._made(key)
                if len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(key)
            return self._kept[key]

    def _made(self, scene: Scene) -> Image:
        """A scene that cannot be pressed is tried less deep, until it can."""
        for _ in range(TRIES):
            try:
                return _fixed(self.sensor.press(scene).image)
            except UserError:
                shallower = scene.pose.depth * 0.95
                scene = replace(scene, pose=replace(scene.pose, depth=shallower))
        return self.rest


def _fixed(image: Image) -> Image:
    out = image.copy()
    out.setflags(write=False)
    return out


def _rounded(scene: Scene) -> Scene:
    pose = scene.pose
    values = {
        name: round(getattr(pose, name) / FINEST_MM) * FINEST_MM
        for name in ("x", "y", "yaw", "tilt", "depth")
    }
    return Scene(scene.indenter, replace(pose, **values))
