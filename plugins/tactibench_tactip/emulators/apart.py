"""Emulators in a process of their own.

ur_rtde needs it: its constructors hold Python's global lock while they wait for the controller, so
that an emulator in the same process could never answer them (and no thread of the caller runs
either: a deadline has to be kept by another process).
"""

from __future__ import annotations

import multiprocessing
from threading import Lock
from types import TracebackType
from typing import Any, Self

from tactibench import Indenter, UserError
from tactibench_tactip.emulators.clock import Clock
from tactibench_tactip.emulators.faults import Fault, Fired
from tactibench_tactip.emulators.log import Envelope, Log
from tactibench_tactip.emulators.poses import Pose6
from tactibench_tactip.emulators.rig import Truth
from tactibench_tactip.emulators.served import serve
from tactibench_tactip.emulators.setup import Ports, Setup

START_S, CALL_S, STOP_S = 60.0, 10.0, 10.0
"""Host seconds within which the process is up (the simulator compiles), has answered, has ended."""


class Apart:
    """A context manager: on entry the emulators of a setup run in another process.

    ports: where. clock: the world's. Everything else is what ``World`` has. Raises UserError as
    the emulators do, and where the process does not come up within a minute.
    """

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._lock = Lock()
        self.ports = Ports()
        self.clock = Clock(setup.time_scale)

    def __enter__(self) -> Self:
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=serve, args=(other, self._setup), daemon=True)
        self._process.start()
        other.close()
        try:
            self.ports, self.clock = self._answer(START_S)
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end()

    @property
    def presses(self) -> int:
        """As ``World.presses``; so are the others."""
        return int(self._call("presses"))

    @property
    def fired(self) -> tuple[Fired, ...]:
        return tuple(self._call("fired"))

    @property
    def log(self) -> Log:
        """A copy."""
        log: Log = self._call("log")
        return log

    def tool(self) -> Pose6:
        tool: Pose6 = self._call("tool")
        return tool

    def truth(self, at_ns: int | None = None) -> Truth:
        truth: Truth = self._call("truth", at_ns)
        return truth

    def truth_of(self, tool: Pose6) -> Truth:
        truth: Truth = self._call("truth_of", tool)
        return truth

    def mount(self, indenter: Indenter) -> None:
        self._call("mount", indenter)

    def keep_to(self, envelope: Envelope | None) -> None:
        self._call("keep_to", envelope)

    def arm(self, *faults: Fault) -> None:
        self._call("arm", *faults)

    def plug(self) -> None:
        """Plug the GRBL controller in again."""
        self._call("plug")

    def messages(self) -> tuple[str, ...]:
        """What the UR controller had to say."""
        return tuple(self._call("messages"))

    def _call(self, name: str, *arguments: Any) -> Any:
        with self._lock:
            self._pipe.send((name, arguments))
            return self._answer(CALL_S)

    def _answer(self, seconds: float) -> Any:
        try:
            if not self._pipe.poll(seconds):
                raise UserError(f"the emulators did not answer within {seconds:g} s.")
            value = self._pipe.recv()
        except (EOFError, OSError):
            raise UserError("the process of the emulators ended; its output says why.") from None
        if isinstance(value, BaseException):
            raise value
        return value

    def _end(self) -> None:
        self._pipe.close()
        self._process.join(STOP_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()
