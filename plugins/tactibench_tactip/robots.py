"""The interface of a robot, the drivers by name, and the driver of any robot object.

Only one thread calls a robot, and of the methods of ``Robot`` only ``connect`` may take long.
"""

from __future__ import annotations

import threading
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import Any, Literal, Protocol

from tactibench import Indenter, UserError
from tactibench_tactip.camera import Camera, DeviceError
from tactibench_tactip.settings import CameraSettings, Pose6, Settings

DRIVERS = MappingProxyType(
    {
        "ur": ("tactibench_tactip.ur", "UrRobot"),
        "grbl": ("tactibench_tactip.grbl", "GrblRobot"),
        "cri": ("tactibench_tactip.robots", "CriRobot"),
    }
)
"""Name in the configuration -> module and class, imported on use."""
SIMULATION = ("tactibench_tactip.simulation", "SimulatedRobot")
HOMING_S = 90.0
"""Time within which a stage reaches its switches, s."""
Purpose = Literal["look", "move", "home"]
"""What a robot is connected for: to be looked at, to move, or to drive to its switches first."""


class RobotError(DeviceError):
    """The robot did not do what it was asked to do. It may be moved away if its state is normal."""


class RobotLostError(RobotError):
    """The connection to the robot is gone."""


class PositionUnknownError(RobotError):
    """Nobody knows where the tool is: the robot can be homed, and nothing else moves it."""


class ProtectiveStopError(RobotError):
    """The robot's controller stopped it to protect somebody or something."""


class GuardError(RobotError):
    """A move was stopped: the force was too great, or the tool left its line."""


class StopNowError(Exception):
    """Somebody asked to stop at once."""


@dataclass(frozen=True)
class RobotState:
    """The state of a robot.

    Attributes:
        normal: Whether it may be moved.
        description: State in the words of its controller.
        stopped: Whether its controller stopped it to protect something.
        force_n: (x, y, z) N in the base frame; None where the robot does not measure it.
        time_s: Time of the robot's own clock.
        speed_share: Share of every speed that a person at the robot allows.
    """

    normal: bool
    description: str = "normal"
    stopped: bool = False
    force_n: tuple[float, float, float] | None = None
    time_s: float | None = None
    speed_share: float = 1.0


class Robot(Protocol):
    """A robot that moves a tool along straight lines.

    Poses are of the tool's centre point in the robot's base frame, mm and deg (sxyz). Methods raise
    RobotError where the robot fails.

    Attributes:
        turns: Whether the tool can be turned.
        at_switches: Whether it is a stage that stands at its switches.
        proviso: Clause about what its pose depends on, "" where that was checked.
    """

    turns: bool
    at_switches: bool = False
    proviso: str = ""

    def connect(self, purpose: Purpose = "move") -> None:
        """Get ready, or raise an error that says why not; it may take ``connect_s``.

        To be looked at, a robot is read only: nothing that runs there is stopped or changed.
        """
        ...

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        """Begin a straight move, and return before it ends.

        Args:
            pose: Pose to move to.
            speed: Top speed, mm/s.
            acceleration: Acceleration, mm/s^2.
        """
        ...

    def moving(self) -> bool:
        """Return whether the move goes on."""
        ...

    def pose(self) -> Pose6:
        """Return the pose of the tool, or raise PositionUnknownError."""
        ...

    def stop(self) -> None:
        """Begin to stop; ``moving`` says when it stands."""
        ...

    def state(self) -> RobotState:
        """Return the present state."""
        ...

    def close(self) -> None:
        """Let go of the robot. Never raises."""
        ...

    def describe(self) -> dict[str, str]:
        """Return versions and settings, for people and the record."""
        ...

    def camera(self, settings: CameraSettings) -> Camera:
        """Return the camera that looks at what this robot presses, not opened yet."""
        return Camera(settings)

    def mount(self, indenter: Indenter) -> bool:  # noqa: ARG002
        """Return whether the robot mounted an indenter by itself; otherwise a person does it."""
        return False


def missing_package(package: str, extra: str, remark: str = "") -> UserError:
    """Return the error for a driver whose package is not installed.

    Args:
        package: Name of the package.
        extra: Extra of tactibench that installs it.
        remark: Text after the advice.
    """
    return UserError(
        f"the package {package} is missing; install it with "
        f"pip install 'tactibench[{extra}]'{remark}."
    )


def make_robot(settings: Settings) -> Robot:
    """Return the robot of a configuration, not connected."""
    module, name = SIMULATION if settings.simulated else DRIVERS[settings.robot.driver]
    robot: Robot = getattr(import_module(module), name)(settings)
    return robot


def connect_seconds(settings: Settings, purpose: Purpose = "move") -> float:
    """Return the time that connecting may take, s, with a stage's way to its switches."""
    may_home = purpose == "home" or (purpose == "move" and settings.robot.homes)
    return settings.robot.connect_s + (HOMING_S if may_home else 0.0)


class CriRobot(Robot):
    """A robot whose ``move_linear`` blocks until it stands: each move runs in a thread of its own.

    The robot is asked for nothing else meanwhile. Its ``stop`` is used where it has one; otherwise
    the move, which is one press at most, runs to its end. ``robot.address`` names a callable that
    makes the robot: ``package.module:callable``, called without arguments. The robot's poses must
    be of the tool in the base frame, in mm and deg in axes sxyz.
    """

    turns = True

    def __init__(self, settings: Settings) -> None:
        self._address = settings.robot.address
        self._tcp = settings.frames.tcp_pose
        self._robot: Any = None
        self._move: threading.Thread | None = None
        self._failure: BaseException | None = None
        self._pose: Pose6 = (0.0,) * 6

    def connect(self, purpose: Purpose = "move") -> None:  # noqa: ARG002
        """Make the robot.

        Raises:
            UserError: ``robot.address`` names no callable, or one that makes an object without
                ``move_linear``, ``pose`` or ``close``.
        """
        module, _, name = self._address.partition(":")
        try:
            make = getattr(import_module(module), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise UserError(
                f"robot.address {self._address!r} cannot be used ({error}); driver cri needs "
                "package.module:callable, the callable that makes the robot."
            ) from None
        self._robot = make()
        for needed in ("move_linear", "pose", "close"):
            if not hasattr(self._robot, needed):
                raise UserError(f"{self._address} makes an object without {needed!r}; add it.")
        for name, value in (("axes", "sxyz"), ("coord_frame", (0.0,) * 6), ("tcp", self._tcp)):
            if hasattr(self._robot, name):
                setattr(self._robot, name, value)
        self._pose = self._read_pose()

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:  # noqa: ARG002
        """Begin a move in a thread of its own."""
        if self._move is not None and self._move.is_alive():
            raise RobotError("the robot was asked to move while it moves; this is a bug.")
        if hasattr(self._robot, "linear_speed"):
            self._robot.linear_speed = speed
        self._move = threading.Thread(target=self._run, args=(pose,), name="cri move", daemon=True)
        self._move.start()

    def _run(self, pose: Pose6) -> None:
        try:
            self._robot.move_linear(pose)
        except BaseException as error:  # noqa: BLE001 - raised again by ``moving``
            self._failure = error

    def moving(self) -> bool:
        """Return whether the move goes on.

        Raises:
            RobotError: The move failed.
        """
        if self._move is None or self._move.is_alive():
            return self._move is not None
        self._move = None
        failure, self._failure = self._failure, None
        if failure is not None:
            raise RobotError(f"move_linear raised {type(failure).__name__}: {failure}.")
        self._pose = self._read_pose()
        return False

    def pose(self) -> Pose6:
        """Return the pose of the tool; during a move, its pose before the move."""
        if self._move is None:
            self._pose = self._read_pose()
        return self._pose

    def _read_pose(self) -> Pose6:
        x, y, z, a, b, c = (float(value) for value in self._robot.pose)
        return x, y, z, a, b, c

    def stop(self) -> None:
        """Stop the robot, where it has a method ``stop``."""
        if hasattr(self._robot, "stop"):
            self._robot.stop()

    def state(self) -> RobotState:
        """Return a normal state: these robots do not report their state."""
        return RobotState(normal=True, description="not told")

    def close(self) -> None:
        """Close the robot."""
        robot, self._robot = self._robot, None
        with suppress(Exception):  # at the end no caller needs the error
            if robot is not None:
                robot.close()

    def describe(self) -> dict[str, str]:
        """Return the kind of robot."""
        info = getattr(self._robot, "info", "")
        return {"driver": "cri", "robot": f"{type(self._robot).__name__} {info}".strip()}
