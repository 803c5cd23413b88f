"""The stage: steps that were counted, and where the tool really is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactibench_tactip.emulators.motion import Profile
from tactibench_tactip.emulators.poses import Array, inverse, matrix
from tactibench_tactip.emulators.world import World


class Stage:
    """Machine coordinates (3,) mm against the world's tool. ``lost``: how far the stage is from
    where the controller counts it, mm."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._to_base = matrix(world.rig.work_frame)
        self._to_work = inverse(self._to_base)
        self.lost = np.zeros(3)

    def place(self, t: float) -> Array:
        """(3,) as counted."""
        return self.true_place(t) - self.lost

    def true_place(self, t: float) -> Array:
        return np.asarray((self._to_base @ self.world.pose_at(t))[:3, 3])

    def speed(self, t: float) -> float:
        """mm/s."""
        return self.world.speed(t)[0]

    def touching(self, t: float) -> bool:
        return self.world.depth(t) >= 0

    def go(self, t: float, steps: Sequence[tuple[Array, Profile]]) -> None:
        """From t on go to counted places by profiles."""
        turned = self._to_base @ self.world.pose_at(t)
        targets = []
        for place, profile in steps:
            tool = turned.copy()
            tool[:3, 3] = place + self.lost
            targets.append((self._to_work @ tool, profile))
        self.world.follow(t, targets)

    def zero(self, t: float, place: Array) -> None:
        """From now on where it is counts as ``place``."""
        self.lost = self.true_place(t) - place

    def slip(self, t: float, acceleration: float) -> None:
        """Stopped at once at speed v the motors miss the steps of v^2 / 2a."""
        speed, way = self.world.speed(t)
        forward = self._to_base[:3, :3] @ way
        self.lost = self.lost - forward * speed * speed / (2 * acceleration)
