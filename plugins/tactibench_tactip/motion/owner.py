"""The one thread that owns the robot. Everything else posts to it."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import suppress
from types import TracebackType
from typing import Any, Self, TypeVar

from tactibench_tactip.failures import RobotError
from tactibench_tactip.motion.mover import TICK_S, Mover
from tactibench_tactip.robots.base import Robot
from tactibench_tactip.robots.connect import connect_seconds, within
from tactibench_tactip.settings import Settings

T = TypeVar("T")
Job = Callable[[Mover], T]
LOOK_S = 0.1
"""Longest wait: a signal that comes just before it is handled when it ends."""


class Owner:
    """Connects on entry and lets go on exit. ``do`` hands a job to the robot's thread and waits.

    halt: stops what moves, also homing while it connects. Raises RobotError when the robot does not
    answer within ``robot.connect_s``, homing not counted.
    """

    def __init__(self, robot: Robot, settings: Settings) -> None:
        self.robot = robot
        self.halt = threading.Event()
        self._settings = settings
        self._jobs: queue.SimpleQueue[tuple[Job[Any], Future[Any]] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        what = f"the robot at {self._settings.robot.address}"
        try:
            within(connect_seconds(self._settings), what, self.robot.connect, self.halt)
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
        RobotError when it has not ended after deadline_s, host seconds. A job that nobody waits for
        any more, for that reason or for Ctrl-C, is told to stop, or never begun."""
        future: Future[T] = Future()
        end = time.monotonic() + deadline_s
        try:
            self._jobs.put((job, future))
            while not future.done() and (left := end - time.monotonic()) > 0:
                wait([future], min(left, LOOK_S))
        except BaseException:
            self._abandon(future)
            raise
        if not future.done():
            self._abandon(future)
            raise RobotError(
                f"the robot's thread has not answered for {deadline_s:.0f} s; it was told to stop. "
                "Look at the robot."
            )
        return future.result()

    def _abandon(self, future: Future[Any]) -> None:
        if not future.done():
            self.halt.set()
            future.cancel()

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
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(job(mover))
            except BaseException as error:  # noqa: BLE001 - handed to who asked
                future.set_exception(error)
        self.robot.close()

    def _tick(self) -> None:
        with suppress(RobotError):  # whoever moves next is told
            self.robot.tick()
