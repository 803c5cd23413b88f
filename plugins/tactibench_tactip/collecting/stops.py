"""Being asked to end: the first Ctrl-C after the press, the second and SIGTERM at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


class Stops:
    """asked: end after this press. stop: what stops the robot, once there is one."""

    def __init__(self, told: Callable[[str], None]) -> None:
        self.asked = threading.Event()
        self.stop: Callable[[], None] = lambda: None
        self._told = told

    def interrupt(self, number: int = signal.SIGINT, _frame: FrameType | None = None) -> None:
        """What a signal does."""
        if number == signal.SIGINT and not self.asked.is_set():
            self.asked.set()
            self._told("ending after this press; Ctrl-C again stops the robot now")
            return
        self.asked.set()
        self._told("stopping the robot")
        self.stop()

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Signals of this process come here inside the block (of the main thread; elsewhere
        nothing changes)."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {n: signal.signal(n, self.interrupt) for n in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
