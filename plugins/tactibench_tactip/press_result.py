"""The outcome of one press of the real sensor."""

from __future__ import annotations

from dataclasses import dataclass, field

from tactibench import Scene
from tactibench_tactip.camera import CameraFrame
from tactibench_tactip.frame_check import FrameCheck
from tactibench_tactip.robots.base import RobotState
from tactibench_tactip.settings import Pose6


@dataclass(frozen=True, eq=False)
class PressResult:
    """The outcome of one press.

    Attributes:
        scene: Scene with the pose that was reached.
        check: Check of its frames.
        settled_ns: End of settling, on the clock of the frames.
        commanded: Pose of the tool in the work frame that was commanded.
        before: Pose of the tool before the frames were taken.
        after: Pose of the tool after the frames were taken.
        state: State of the robot before the frames were taken.
        z0: First touch from which the depth is counted, mm.
        looks: Number of times that frames were taken.
        frames: Frames of the last look.
    """

    scene: Scene
    check: FrameCheck
    settled_ns: int
    commanded: Pose6
    before: Pose6
    after: Pose6
    state: RobotState
    z0: float
    looks: int
    frames: tuple[CameraFrame, ...] = field(repr=False, default=())
