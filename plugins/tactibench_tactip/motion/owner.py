"""The one thread that owns the robot. Everything else posts to it."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from types import TracebackType
from typing import Any, Self, TypeVar

from tactibench_tactip.failures import RobotError
from tactibench_tactip.motion.mover import TICK_S, Mover
from tactibench_tactip.robots.base import Robot
from tactibench_tactip.robots.connect import within
from tactibench_tactip.settings import Settings

T = TypeVar("T")
Job = Callable[[Mover], T]


class Owner:
    """Connects on entry and lets go on exit. ``do`` hands a job to the robot's thread and waits.

    Raises RobotError when the robot does not answer within ``robot.connect_s``.
    """

    def __init__(self, robot: Robot, settings: Settings) -> None:
        self.robot = robot
        self.halt = threading.Event()
        self._settings = settings
        self._jobs: queue.SimpleQueue[tuple[Job[Any], Future[Any]] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        keys = self._settings.robot
        try:
            within(keys.connect_s, f"the robot at {keys.address}", self.robot.connect)
        except BaseException:
            self.robot.close()
            raise
        self._thread = threading.Thread(target=self._run, name="tactip robot", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._jobs.put(None)
        if self._thread is not None:
            self._thread.join(10.0)

    def do(self, job: Job[T], deadline_s: float) -> T:
        """The answer of a job that the robot's thread does. Raises what the job raises, and
        RobotError when it has not ended after deadline_s, host seconds: the robot is stopped."""
        future: Future[T] = Future()
        self._jobs.put((job, future))
        try:
            return future.result(deadline_s)
        except TimeoutError:
            if future.done():
                raise
            self.halt.set()
            raise RobotError(
                f"the robot's thread has not answered for {deadline_s:.0f} s; it was told to stop. "
                "Look at the robot."
            ) from None

    def _run(self) -> None:
        mover = Mover(self.robot, self._settings, self.halt)
        while True:
            try:
                item = self._jobs.get(timeout=TICK_S)
            except queue.Empty:
                self._tick()
                continue
            if item is None:
                break
            job, future = item
            try:
                future.set_result(job(mover))
            except BaseException as error:  # noqa: BLE001 - handed to who asked
                future.set_exception(error)
        self.robot.close()

    def _tick(self) -> None:
        with suppress(RobotError):  # whoever moves next is told
            self.robot.tick()
