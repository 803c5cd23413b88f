"""The interface of a robot, and the drivers by name.

Only one thread calls a robot, and of the methods of ``Robot`` only ``connect`` may take long.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import Protocol, TypeVar, runtime_checkable

from tactibench import UserError
from tactibench_tactip.errors import RobotError, StopNowError
from tactibench_tactip.settings import Pose6, Settings

T = TypeVar("T")

DRIVERS = MappingProxyType(
    {
        "ur": ("tactibench_tactip.robots.ur", "UrRobot"),
        "grbl": ("tactibench_tactip.robots.grbl", "GrblRobot"),
        "cri": ("tactibench_tactip.robots.cri", "CriRobot"),
    }
)
"""Name in the configuration -> module and class, imported on use."""
LOOK_S = 0.05
"""Longest wait between two checks whether to stop."""

HOMING_S = 90.0
"""Time within which a stage reaches its switches, s."""


@dataclass(frozen=True)
class RobotState:
    """The state of a robot.

    Attributes:
        normal: Whether it may be moved.
        description: State in the words of its controller.
        stopped: Whether its controller stopped it to protect something.
        force_n: (x, y, z) N in the base frame; None where the robot does not measure it.
        time_s: Time of the robot's own clock.
    """

    normal: bool
    description: str = "normal"
    stopped: bool = False
    force_n: tuple[float, float, float] | None = None
    time_s: float | None = None


class Robot(Protocol):
    """A robot that moves a tool along straight lines.

    Poses are of the tool's centre point in the robot's base frame, mm and deg (sxyz). Methods raise
    RobotError where the robot fails.

    Attributes:
        turns: Whether the tool can be turned.
        at_switches: Whether it is a stage that stands at its switches.
    """

    turns: bool
    at_switches: bool = False

    def connect(self) -> None:
        """Get ready to move, or raise an error that says why not; it may take ``connect_s``."""
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
        """Return the pose of the tool."""
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


@runtime_checkable
class RecoverableRobot(Protocol):
    """A robot whose protective stop can be released from here."""

    def recover(self) -> None:
        """Release the stop and get ready again.

        Raises:
            RobotError: The stop cannot be released.
        """
        ...


@runtime_checkable
class ProbingRobot(Protocol):
    """A robot that stops by itself where a probe closes its contact."""

    def probe(self, pose: Pose6, speed: float) -> Pose6 | None:
        """Move towards a pose until the probe's contact closes.

        Args:
            pose: The pose.
            speed: Speed, mm/s.

        Returns:
            The pose at which the contact closed; None: it did not close.
        """
        ...


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
    """Return the driver of a configuration, not connected."""
    module, name = DRIVERS[settings.robot.driver]
    robot: Robot = getattr(import_module(module), name)(settings)
    return robot


def connect_seconds(settings: Settings) -> float:
    """Return the time that connecting may take, s, with a stage's way to its switches."""
    return settings.robot.connect_s + (HOMING_S if settings.robot.homes else 0.0)


def run_within(
    seconds: float, name: str, job: Callable[[], T], halt: threading.Event | None = None
) -> T:
    """Return the result of a job that may hang; the thread of such a job is left behind.

    Errors of the job are raised here.

    Args:
        seconds: Time within which the job must end.
        name: Name of the robot, for the message.
        job: Function without arguments.
        halt: Event that ends the wait.

    Raises:
        RobotError: The job did not end in time.
        StopNowError: ``halt`` was set meanwhile.
    """
    results: list[T] = []
    failures: list[BaseException] = []

    def work() -> None:
        try:
            results.append(job())
        except BaseException as error:  # noqa: BLE001 - raised again by the caller
            failures.append(error)

    thread = threading.Thread(target=work, name=f"tactip {name}", daemon=True)
    thread.start()
    end = time.monotonic() + seconds
    halt = halt or threading.Event()
    while thread.is_alive() and not halt.is_set() and (left := end - time.monotonic()) > 0:
        thread.join(min(left, LOOK_S))
    if failures:
        raise failures[0]
    if results:
        return results[0]
    if halt.is_set():
        raise StopNowError
    raise RobotError(
        f"{name} did not answer within {seconds:g} s; check that it is switched on and that "
        "robot.address is right."
    )
