"""The moves of a press: above, near, down, and straight back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactibench import Scene
from tactibench_tactip.geometry.press import PressGeometry, touch_height
from tactibench_tactip.motion.mover import Guard, Mover
from tactibench_tactip.motion.times import move_seconds
from tactibench_tactip.settings import Pose6, Settings

NEAR_MM = 1.0
"""Before first touch, where the slow descent begins."""


@dataclass(frozen=True)
class Way:
    """The poses of one press in the work frame, and its speeds, mm/s."""

    above: Pose6
    near: Pose6
    down: Pose6
    approach: float
    press: float
    retract: float

    @property
    def poses(self) -> tuple[Pose6, ...]:
        return self.above, self.near, self.down


def way(scene: Scene, geometry: PressGeometry, settings: Settings) -> Way:
    """Where a press goes. Sideways it moves only above, at one height for all places."""
    keys = settings.robot
    return Way(
        geometry.at_depth(scene, clear_depth(scene, geometry, settings)),
        geometry.at_depth(scene, min(-NEAR_MM, scene.pose.depth)),
        geometry.tool_pose(scene),
        keys.approach_mm_s,
        keys.press_mm_s,
        keys.retract_mm_s,
    )


def clear_depth(scene: Scene, geometry: PressGeometry, settings: Settings) -> float:
    """The negative depth at which the whole indenter is ``clearance_mm`` above the apex."""
    clearance = settings.envelope.clearance_mm
    if scene.indenter.is_plate:
        return -clearance
    longest = max(offset[2] for offset in scene.indenter.offsets)
    return touch_height(scene, geometry.dome_radius) - longest - clearance


def seconds(trip: Way, settings: Settings, sideways_mm: float = 7.0) -> float:
    """What a press takes in device seconds, capture left out; sideways_mm: from the one before."""
    a = settings.robot.acceleration_mm_s2
    aside = replace_x(trip.above, sideways_mm)
    return (
        move_seconds(aside, trip.above, trip.approach, a)
        + move_seconds(trip.above, trip.near, trip.approach, a)
        + move_seconds(trip.near, trip.down, trip.press, a)
        + settings.timing.settle_s
        + move_seconds(trip.down, trip.above, trip.retract, a)
    )


def replace_x(pose: Pose6, by: float) -> Pose6:
    x, *others = pose
    return (x + by, *others)  # type: ignore[return-value]


def descend(mover: Mover, trip: Way, guard: Guard) -> None:
    """From wherever it is, at clearance: above, near, down."""
    mover.go(trip.above, trip.approach)
    mover.go(trip.near, trip.approach, guard)
    mover.go(trip.down, trip.press, guard)


def force_guard(mover: Mover, most_n: float) -> Guard:
    """Says so when the force differs by more than most_n from what it is now."""
    before = mover.force()

    def guard(_: Pose6) -> str:
        now = mover.force()
        if before is None or now is None:
            return ""
        change = float(np.linalg.norm(now - before))
        if change <= most_n:
            return ""
        return (
            f"the force changed by {change:.1f} N, envelope.max_force_n allows {most_n:g} N; "
            "look what is in the way."
        )

    return guard


def withdraw(mover: Mover, scene: Scene, geometry: PressGeometry, settings: Settings) -> None:
    """Straight back along the approach axis to clearance; nothing when the tool is that high."""
    here = mover.pose()
    reached = geometry.reached(scene, here)
    clear = clear_depth(reached, geometry, settings)
    if not np.isfinite(clear):  # beside the dome: up along the work frame's own axis
        raise_straight(mover, geometry, settings)
    elif reached.pose.depth > clear + 0.05:
        mover.go(geometry.at_depth(reached, clear), settings.robot.retract_mm_s)


def raise_straight(mover: Mover, geometry: PressGeometry, settings: Settings) -> None:
    """From wherever it is, up along the work frame's z until the whole indenter is clearance_mm
    above the apex, before any sideways motion."""
    here = mover.pose()
    longest = max(offset[2] for offset in settings.indenter.indenter().offsets)
    high = geometry.z0 - longest - settings.envelope.clearance_mm
    if here[2] > high + 0.05:
        x, y, _, *turn = here
        mover.go((x, y, high, *turn), settings.robot.approach_mm_s)  # type: ignore[arg-type]
