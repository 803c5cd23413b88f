"""Getting a robot, within a time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from tactibench import UserError
from tactibench_tactip.failures import RobotError, StopNowError
from tactibench_tactip.robots.base import HOMING_S, Robot
from tactibench_tactip.settings import Settings

T = TypeVar("T")
LOOK_S = 0.05


def connect_seconds(settings: Settings) -> float:
    """How long connecting may take: ``connect_s``, and the way of a stage to its switches."""
    keys = settings.robot
    return keys.connect_s + (HOMING_S if keys.driver == "grbl" and keys.home else 0.0)


def within(
    seconds: float, what: str, job: Callable[[], T], halt: threading.Event | None = None
) -> T:
    """Do a job that may hang, in a thread that is left behind then. Raises RobotError, and
    StopNowError when halt is set meanwhile."""
    done: list[T] = []
    failed: list[BaseException] = []

    def work() -> None:
        try:
            done.append(job())
        except BaseException as error:  # noqa: BLE001 - raised again by the caller
            failed.append(error)

    thread = threading.Thread(target=work, name=f"tactip {what}", daemon=True)
    thread.start()
    end = time.monotonic() + seconds
    halt = halt or threading.Event()
    while thread.is_alive() and not halt.is_set() and (left := end - time.monotonic()) > 0:
        thread.join(min(left, LOOK_S))
    if failed:
        raise failed[0]
    if done:
        return done[0]
    if halt.is_set():
        raise StopNowError
    raise RobotError(
        f"{what} did not answer within {seconds:g} s; check that it is switched on and that "
        "robot.address is right."
    )


def robot_of(settings: Settings) -> Robot:
    """The driver of a configuration, not connected. Raises UserError for a missing package."""
    keys = settings.robot
    if keys.driver == "ur":
        from tactibench_tactip.robots.ur import UrRobot

        return UrRobot(settings)
    if keys.driver == "grbl":
        from tactibench_tactip.robots.grbl import GrblRobot

        return GrblRobot(settings)
    from tactibench_tactip.robots.cri import CriRobot

    return CriRobot(settings)


def missing(package: str, extra: str, why: str = "") -> UserError:
    """A driver's package is not installed."""
    return UserError(
        f"the package {package} is missing; install it with pip install 'tactibench[{extra}]'{why}."
    )
