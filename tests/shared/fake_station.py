"""A robot that is where it was sent, and a camera that sees how deep that is."""

from __future__ import annotations

import threading
import time
import tomllib
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from tactibench import Pose, Scene
from tactibench_tactip.poses import inverse, matrix, pose_of
from tactibench_tactip.press_geometry import PressGeometry
from tactibench_tactip.robots.base import RobotState
from tactibench_tactip.settings import Pose6, Settings, example_configuration

TRUE_Z0 = 0.35
FIXED_TOUCH = {"method": "fixed", "fixed_mm": TRUE_Z0}
"""Table [contact] with which nothing is searched."""
SIDE = 48


class FakeRobot:
    """Every move is done at once. fails: called at every move with its number, and may raise."""

    turns, at_switches = True, False

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.work = matrix(settings.frames.work_frame)
        self.at: Pose6 = pose_of(self.work @ matrix((0.0, 0.0, -40.0, 0.0, 0.0, 0.0)))
        self.moves: list[Pose6] = []
        self.normal, self.stopped, self.stops, self.closed = True, False, 0, False
        self.busy = False
        self.fails: Callable[[int], None] = lambda _: None
        self.force: tuple[float, float, float] | None = None
        self.stiffness: float | None = None

    def connect(self) -> None: ...

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        self.moves.append(pose)
        self.fails(len(self.moves))
        self.at = pose

    def moving(self) -> bool:
        return self.busy

    def pose(self) -> Pose6:
        return self.at

    def stop(self) -> None:
        self.stops += 1
        self.busy = False

    def state(self) -> RobotState:
        force = None if self.stiffness is None else (0.0, 0.0, self.stiffness * self.depth())
        return RobotState(self.normal, "fake", self.stopped, self.force or force)

    def depth(self) -> float:
        """Past the true first touch on the work frame's axis, at least 0."""
        return max(0.0, self.tool()[2] - TRUE_Z0)

    def close(self) -> None:
        self.closed = True

    def describe(self) -> dict[str, str]:
        return {"driver": "fake"}

    def tool(self) -> Pose6:
        """In the work frame."""
        return pose_of(inverse(self.work) @ matrix(self.at))


class FakeCapture:
    """Frames of a sensor under the robot's tool; what a ``cv2.VideoCapture`` offers."""

    def __init__(self, robot: FakeRobot | None = None) -> None:
        self.robot = robot
        self.rng = np.random.default_rng(0)
        rows, columns = np.indices((SIDE, SIDE))
        self.rest = 30.0 + 120.0 * ((rows % 8 < 3) & (columns % 8 < 3))
        self.pattern = np.roll(self.rest, 1, axis=0) - self.rest
        self.properties: dict[int, float] = {}
        self.refused: set[int] = set()
        self.stalled = threading.Event()
        self.gone = False
        self.opened = 0

    def depth(self) -> float:
        if self.robot is None:
            return 0.0
        settings = self.robot.settings
        geometry = PressGeometry(settings.frames, settings.sensor.dome_radius_mm, TRUE_Z0)
        scene = Scene(settings.indenter.indenter(), Pose())
        return geometry.reached(scene, self.robot.tool()).pose.depth

    def grab(self) -> bool:
        time.sleep(0.001)
        while self.stalled.is_set():
            time.sleep(0.005)
        return not self.gone

    def retrieve(self) -> tuple[bool, Any]:
        image = self.rest + self.pattern * min(0.5, 0.1 * max(0.0, self.depth()))
        noisy = image + self.rng.normal(0.0, 1.0, image.shape)
        return True, np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    def set(self, name: int, value: float) -> bool:
        if name in self.refused:
            return False
        self.properties[name] = value
        return True

    def get(self, name: int) -> float:
        return self.properties.get(name, {cv2.CAP_PROP_AUTO_EXPOSURE: 3.0}.get(name, 0.0))

    def getBackendName(self) -> str:
        return "V4L2"

    def isOpened(self) -> bool:
        return True

    def release(self) -> None: ...


def make_settings(**tables: dict[str, Any]) -> Settings:
    """Return settings of a UR with a fake camera; tables: changes."""
    configuration = tomllib.loads(example_configuration("ur"))
    configuration["camera"] = {"source": "fake", "fps": 500.0, "warmup_frames": 3}
    del configuration["sensor"]["pins"]
    configuration["timing"]["settle_s"] = 0.0
    for name, values in tables.items():
        configuration[name] |= values
    return Settings.model_validate(configuration)


def stand_in(robot: FakeRobot, put: Callable[[Any, str, Any], None]) -> None:
    """Let every station that is made have this robot, with a camera beside it. put: ``setattr`` of
    a patch."""
    from tactibench_tactip import collection, station
    from tactibench_tactip.camera import Camera

    capture = FakeCapture(robot)
    for module in (station, collection):
        put(module, "make_robot", lambda _: robot)
        put(module, "Camera", lambda settings: Camera(settings, lambda _: capture))
