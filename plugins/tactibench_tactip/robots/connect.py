"""The robot of a configuration, connected within a time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from tactibench_tactip.errors import RobotError, StopNowError
from tactibench_tactip.robots.base import HOMING_S, Robot
from tactibench_tactip.settings import Settings

T = TypeVar("T")
LOOK_S = 0.05


def make_robot(settings: Settings) -> Robot:
    """Return the driver of a configuration, not connected."""
    if settings.robot.driver == "ur":
        from tactibench_tactip.robots.ur import UrRobot

        return UrRobot(settings)
    if settings.robot.driver == "grbl":
        from tactibench_tactip.robots.grbl import GrblRobot

        return GrblRobot(settings)
    from tactibench_tactip.robots.cri import CriRobot

    return CriRobot(settings)


def connect_seconds(settings: Settings) -> float:
    """Return s that connecting may take: ``connect_s``, and a stage's way to its switches."""
    homes = settings.robot.driver == "grbl" and settings.robot.home
    return settings.robot.connect_s + (HOMING_S if homes else 0.0)


def run_within(
    seconds: float, name: str, job: Callable[[], T], halt: threading.Event | None = None
) -> T:
    """Return the result of a job that may hang, from a thread that is left behind then.

    Raises RobotError when the time is over, and StopNowError when halt is set meanwhile.
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
