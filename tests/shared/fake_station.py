"""A robot that is where it was sent, and a camera that sees how deep that is."""

from __future__ import annotations

import json
import sys
import threading
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np

from tactibench import Indenter, Pose, Scene
from tactibench_tactip import (
    Camera,
    CameraSettings,
    Pose6,
    PressGeometry,
    RobotState,
    Settings,
    inverse,
    matrix,
    pose_of,
)

EXAMPLE = (Path(__file__).parents[2] / "plugins/tactibench_tactip/example.toml").read_text("utf-8")
"""What ``hw example`` writes."""
STAGE = EXAMPLE.replace('driver = "ur"', 'driver = "grbl"').replace("# home = true", "home = true")
TRUE_Z0 = 0.35
FIXED_TOUCH = {"method": "fixed", "fixed_mm": TRUE_Z0}
"""Table [contact] with which nothing is searched."""
SIDE = 48


class FakeRobot:
    """Every move is done at once. fails: called at every move with its number, and may raise."""

    turns, at_switches, proviso = True, False, ""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.work = matrix(settings.frames.work_frame)
        self.from_base = inverse(self.work)
        self.at: Pose6 = pose_of(self.work @ matrix((0.0, 0.0, -40.0, 0.0, 0.0, 0.0)))
        self.moves: list[Pose6] = []
        self.normal, self.stopped, self.stops, self.closed = True, False, 0, False
        self.busy = False
        self.fails: Callable[[int], None] = lambda _: None
        self.force: tuple[float, float, float] | None = None
        self.stiffness: float | None = None
        self.capture: FakeCapture | None = None

    def connect(self, purpose: str = "move") -> None: ...

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

    def camera(self, settings: CameraSettings) -> Camera:
        capture = self.capture or FakeCapture(self)
        return Camera(settings, lambda _: capture)

    def mount(self, indenter: Indenter) -> bool:
        return False

    def close(self) -> None:
        self.closed = True

    def describe(self) -> dict[str, str]:
        return {"driver": "fake"}

    def tool(self) -> Pose6:
        """In the work frame."""
        return pose_of(self.from_base @ matrix(self.at))


class Looking(FakeRobot):
    """The control loop turns a few times in every move."""

    ticks = 0

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        self.busy, self.ticks = True, 3
        super().start(pose, speed, acceleration)

    def moving(self) -> bool:
        self.ticks -= 1
        self.busy = self.busy and self.ticks > 0
        return self.busy


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


def make_tables(**tables: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a UR with a fake camera; tables: changes."""
    configuration = tomllib.loads(EXAMPLE)
    camera = {"source": "fake", "fps": 500.0, "warmup_frames": 3, "lag_s": 0.0}
    configuration["camera"] = camera
    del configuration["sensor"]["pins"]
    configuration["timing"]["settle_s"] = 0.0
    for name, values in tables.items():
        configuration[name] |= values
    return configuration


def make_settings(**tables: dict[str, Any]) -> Settings:
    """Return settings of a UR with a fake camera; tables: changes."""
    return Settings.model_validate(make_tables(**tables))


def write_settings(path: Path, **tables: dict[str, Any]) -> Path:
    """Write and return a configuration of a UR with a fake camera; tables: changes."""
    lines = ["schema = 1"]
    for name, table in make_tables(**tables).items():
        if name != "schema":
            lines += [f"[{name}]", *(f"{key} = {json.dumps(v)}" for key, v in table.items())]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def stand_in(make: Callable[[Settings], FakeRobot], patch: Any) -> None:
    """Let every configuration have the robot that ``make`` returns, and its camera. patch: pytest's
    monkeypatch."""
    module = ModuleType("robot_that_stands_in")
    module.make = make  # type: ignore[attr-defined]
    patch.setitem(sys.modules, module.__name__, module)
    names = dict.fromkeys(("ur", "grbl", "cri"), (module.__name__, "make"))
    patch.setattr("tactibench_tactip.robots.DRIVERS", names)
    patch.setattr("tactibench_tactip.robots.SIMULATION", names["ur"])


def finish(robot: Any) -> None:
    """Wait until a robot has ended its move."""
    while robot.moving():
        time.sleep(0.001)
