"""What the controller's contact detection does."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactibench_tactip.emulators.levels import Level
from tactibench_tactip.emulators.motion import Line, Profile, trapezoid
from tactibench_tactip.emulators.poses import Array

if TYPE_CHECKING:
    from tactibench_tactip.emulators.ur.script import Script

CONTACT_STOP, CONTACT_BACK = 3.0, 0.01
"""m/s2 of the stop at a contact, and m/s of the way back to where it was first seen."""


class Contact:
    """Waits for the contact force; then stops the arm and brings it back to where it was."""

    def __init__(self, script: Script) -> None:
        self._script = script
        self.seen, self.over = False, False
        world = script.controller.world
        level = Level("force", script.controller.contact_force_n, self._touched)
        self._number = world.watch(level)

    def _touched(self, t: float) -> None:
        self.seen = True
        self._script.finish()
        arm, world = self._script.controller.arm, self._script.controller.world
        back = world.pose_at(t)
        arm.stop(t, CONTACT_STOP)
        end = world.still_s
        way = Line(world.pose_at(end), back)
        if way.length > 0:
            profile = trapezoid(way.length, CONTACT_BACK * 1000, CONTACT_STOP * 1000)
            world.alarm(end, lambda now: self._bring_back(now, [(back, profile)]))

    def _bring_back(self, t: float, steps: list[tuple[Array, Profile]]) -> None:
        if self._script.controller.script is self._script:
            self._script.controller.world.follow(t, steps)

    def end(self) -> None:
        self._script.controller.world.forget(self._number)
