"""The moves of a press: above, near, down, and straight back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactibench import Scene
from tactibench_tactip.motion import Guard, Mover, move_seconds
from tactibench_tactip.press_geometry import PressGeometry, touch_height
from tactibench_tactip.settings import Pose6, Settings

NEAR_MM = 1.0
"""Distance before first touch at which the slow descent begins."""
SLACK_MM = 0.05
"""Distance below clearance at which the tool still counts as being at clearance."""


@dataclass(frozen=True)
class PressPath:
    """The poses of one press in the work frame.

    Attributes:
        above: Pose at clearance.
        near: Pose before first touch, where the slow descent begins.
        down: Pose at the depth of the press.
    """

    above: Pose6
    near: Pose6
    down: Pose6

    @property
    def poses(self) -> tuple[Pose6, ...]:
        """All poses, in order."""
        return self.above, self.near, self.down


def path_of(scene: Scene, geometry: PressGeometry, settings: Settings) -> PressPath:
    """Return the path of a press: it moves sideways only above, at one height for all places."""
    return PressPath(
        geometry.at_depth(scene, clear_depth(scene, geometry, settings)),
        geometry.at_depth(scene, min(-NEAR_MM, scene.pose.depth)),
        geometry.tool_pose(scene),
    )


def clear_depth(scene: Scene, geometry: PressGeometry, settings: Settings) -> float:
    """Return the negative depth at which the whole indenter is ``clearance_mm`` above the apex."""
    clearance = settings.envelope.clearance_mm
    if scene.indenter.is_plate:
        return -clearance
    longest = max(offset[2] for offset in scene.indenter.offsets)
    return touch_height(scene, geometry.dome_radius) - longest - clearance


def path_seconds(path: PressPath, settings: Settings, sideways_mm: float = 7.0) -> float:
    """Return the device seconds that a press takes, without its frames.

    Args:
        path: Path of the press.
        settings: Configuration of the setup.
        sideways_mm: Distance from the press before.
    """
    robot = settings.robot
    a = robot.acceleration_mm_s2
    x, y, z, *turn = path.above
    before: Pose6 = (x + sideways_mm, y, z, *turn)  # type: ignore[assignment]
    return (
        move_seconds(before, path.above, robot.approach_mm_s, a)
        + move_seconds(path.above, path.near, robot.approach_mm_s, a)
        + move_seconds(path.near, path.down, robot.press_mm_s, a)
        + settings.timing.settle_s
        + move_seconds(path.down, path.above, robot.retract_mm_s, a)
    )


def descend(mover: Mover, path: PressPath, settings: Settings, guard: Guard) -> None:
    """Move along a path, above, near and down, from any place at clearance.

    Args:
        mover: Mover of the robot.
        path: Path of the press.
        settings: Configuration of the setup, which gives the speeds.
        guard: Guard of the moves to near and down.
    """
    robot = settings.robot
    mover.go(path.above, robot.approach_mm_s)
    mover.go(path.near, robot.approach_mm_s, guard)
    mover.go(path.down, robot.press_mm_s, guard)


def force_guard(mover: Mover, most_n: float) -> Guard:
    """Return a guard that stops where the force differs by more than ``most_n`` from now."""
    before = mover.force()

    def guard(_: Pose6) -> str:
        force = mover.force()
        if before is None or force is None:
            return ""
        change = float(np.linalg.norm(force - before))
        if change <= most_n:
            return ""
        return (
            f"the force changed by {change:.1f} N, envelope.max_force_n allows {most_n:g} N; "
            "look what is in the way."
        )

    return guard


def withdraw(mover: Mover, scene: Scene, geometry: PressGeometry, settings: Settings) -> None:
    """Move straight back along the approach axis to clearance, unless the tool is that high."""
    reached = geometry.reached(scene, mover.pose())
    clear = clear_depth(reached, geometry, settings)
    if not np.isfinite(clear):  # beside the dome: up along the work frame's own axis
        raise_straight(mover, geometry, settings)
    elif reached.pose.depth > clear + SLACK_MM:
        mover.go(geometry.at_depth(reached, clear), settings.robot.retract_mm_s)


def clear_height(geometry: PressGeometry, settings: Settings) -> float:
    """Return z of the work frame, mm, where the mounted indenter is clearance_mm over the apex."""
    longest = max(offset[2] for offset in settings.indenter.indenter().offsets)
    return geometry.z0 - longest - settings.envelope.clearance_mm


def raise_straight(mover: Mover, geometry: PressGeometry, settings: Settings) -> None:
    """Move up along the work frame's z until the whole indenter is clearance_mm above the apex.

    It starts from any place, and comes before any sideways motion.
    """
    x, y, z, a, b, c = mover.pose()
    high = clear_height(geometry, settings)
    if z > high + SLACK_MM:
        mover.go((x, y, high, a, b, c), settings.robot.approach_mm_s)
