"""Moving the tool: every target checked, every wait ends, everything noticed on the way."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from tactibench_tactip.failures import (
    ProtectiveStopError,
    RobotError,
    StopNowError,
    TrippedError,
)
from tactibench_tactip.geometry.envelope import outside
from tactibench_tactip.geometry.frames import Array, apart, inverse, matrix, pose_of, turned_by
from tactibench_tactip.motion.times import move_seconds, patience
from tactibench_tactip.robots.base import Probes, Robot, RobotState
from tactibench_tactip.settings import Pose6, Settings

TICK_S = 0.008
"""Of the control loop: 125 Hz."""
REACHED_MM, REACHED_DEG = 0.1, 0.2
OFF_LINE_MM = 2.0
"""How far beside its line the tool may be seen before a move is stopped."""
STOP_S = 3.0
PROBE_MM = 0.5
"""Between two looks at whether to stop, while it probes."""

Guard = Callable[[Pose6], str]
"""Looks at the pose in the work frame during a move; a reason stops it, "" lets it go on."""


class Mover:
    """Moves a robot in the work frame. Used by one thread only, the one that owns the robot.

    halt: set from outside to stop at once.
    """

    def __init__(self, robot: Robot, settings: Settings, halt: threading.Event) -> None:
        self._robot = robot
        self._settings = settings
        self._halt = halt
        self._work = matrix(settings.frames.work_frame)

    def pose(self) -> Pose6:
        """Where the tool is, in the work frame."""
        return pose_of(inverse(self._work) @ matrix(self._robot.pose()))

    def state(self) -> RobotState:
        return self._robot.state()

    def force(self) -> Array | None:
        """(3,) N in the work frame; None where nobody measures it."""
        found = self._robot.state().force_n
        turn: Array = self._work[:3, :3]
        return None if found is None else turn.T @ found

    def go(self, target: Pose6, speed: float, guard: Guard | None = None) -> None:
        """Move straight to a pose in the work frame and wait for it.

        Raises RobotError for a target outside the envelope, a robot that is not normal, stands
        still, leaves its line or needs too long; TrippedError when the guard says so; StopNowError.
        """
        wrong = outside(self._settings.envelope, target)
        if wrong:
            raise RobotError(f"the tool was to go to {wrong}; nothing was moved.")
        self._go(target, speed, guard)

    def come_in(self, speed: float) -> None:
        """From a stage's switches, which may lie outside the envelope, into it: sideways at the
        height of the switches, then down. Raises RobotError where that height is not clear."""
        keys = self._settings.envelope
        _, _, z, *turn = self.pose()
        if z > -keys.clearance_mm:
            raise RobotError(
                f"the stage's switches are at z {z:.1f} mm of the work frame, not above the "
                f"sensor's clearance of {-keys.clearance_mm:g} mm; check frames.work_frame."
            )
        self._go((0.0, 0.0, z, *turn), speed, None)  # type: ignore[arg-type]
        self._go((0.0, 0.0, max(z, -keys.above_mm), *turn), speed, None)  # type: ignore[arg-type]

    def _go(self, target: Pose6, speed: float, guard: Guard | None) -> None:
        if self._halt.is_set():
            raise StopNowError
        start = self.pose()
        self._demand_normal()
        for again in (False, True):
            self._robot.start(pose_of(self._work @ matrix(target)), speed, self._acceleration)
            self._wait(start, target, speed, guard)
            here = self.pose()
            if apart(here, target) < REACHED_MM and turned_by(here, target) < REACHED_DEG:
                return
            if again or apart(here, start) > REACHED_MM or turned_by(here, start) > REACHED_DEG:
                raise RobotError(
                    f"the robot stopped {apart(here, target):.2f} mm and "
                    f"{turned_by(here, target):.1f} deg before its target; look whether somebody "
                    "held it."
                )

    def probe(self, target: Pose6, speed: float, guard: Guard) -> Pose6 | None:
        """Towards a pose in the work frame until a probe's contact closes; None: it did not.

        In short steps, for the robot answers nothing in one. Raises as ``go``.
        """
        wrong = outside(self._settings.envelope, target)
        if wrong:
            raise RobotError(f"the probe was to go to {wrong}; nothing was moved.")
        robot = self._robot
        assert isinstance(robot, Probes), "asked before"  # noqa: S101
        start = self.pose()
        steps = max(1, math.ceil(apart(start, target) / PROBE_MM))
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            if self._halt.is_set():
                raise StopNowError
            self._demand_normal()
            reason = guard(self.pose())
            if reason:
                raise TrippedError(reason)
            x, y, z = (a + share * (b - a) for a, b in zip(start[:3], target[:3], strict=True))
            met = robot.probe(pose_of(self._work @ matrix((x, y, z, *target[3:]))), speed)
            if met is not None:
                return pose_of(inverse(self._work) @ matrix(met))
        return None

    def stop(self) -> None:
        """Stop and wait until it stands, at most STOP_S."""
        self._robot.stop()
        end = time.monotonic() + STOP_S
        while self._robot.moving() and time.monotonic() < end:
            self._robot.tick()
            time.sleep(TICK_S)

    def rest(self, seconds: float) -> None:
        """Stand still for seconds of the devices' clock."""
        end = time.monotonic() + seconds / self._settings.robot.time_scale
        while (left := end - time.monotonic()) > 0:
            if self._halt.is_set():
                raise StopNowError
            self._robot.tick()
            time.sleep(min(TICK_S, left))

    @property
    def _acceleration(self) -> float:
        return self._settings.robot.acceleration_mm_s2

    def _wait(self, start: Pose6, target: Pose6, speed: float, guard: Guard | None) -> None:
        scale = self._settings.robot.time_scale
        expected = move_seconds(start, target, speed, self._acceleration)
        end = time.monotonic() + patience(expected, scale)
        try:
            while self._robot.moving():
                self._robot.tick()
                if self._halt.is_set():
                    raise StopNowError
                self._demand_normal()
                if guard is not None:
                    self._look(start, target, guard)
                if time.monotonic() > end:
                    raise RobotError(
                        f"a move of {apart(start, target):.1f} mm took longer than "
                        f"{patience(expected, scale):.1f} s; look whether the robot is held or "
                        "slowed down."
                    )
                time.sleep(TICK_S)
        except BaseException:
            self._stop_quietly()
            raise
        self._demand_normal()

    def _look(self, start: Pose6, target: Pose6, guard: Guard) -> None:
        here = self.pose()
        beside = beside_line(start, target, here)
        if beside > OFF_LINE_MM:
            raise TrippedError(f"the tool was {beside:.1f} mm beside its line.")
        reason = guard(here)
        if reason:
            raise TrippedError(reason)

    def _demand_normal(self) -> None:
        state = self._robot.state()
        if state.stopped:
            raise ProtectiveStopError(f"the robot is not normal: {state.words}.")
        if not state.normal:
            raise RobotError(f"the robot is not normal: {state.words}.")

    def _stop_quietly(self) -> None:
        with suppress(RobotError):  # the reason for stopping is what is told
            self.stop()


def beside_line(start: Pose6, end: Pose6, here: Pose6) -> float:
    """Distance of a position from the line between two, mm."""
    a, b, p = (np.array(pose[:3]) for pose in (start, end, here))
    along = b - a
    length = float(along @ along)
    share = 0.0 if length == 0 else min(1.0, max(0.0, float((p - a) @ along) / length))
    return float(np.linalg.norm(p - a - share * along))
