"""The connection to the process that holds a UR."""

from __future__ import annotations

import json
import secrets
import subprocess
import sys
import tempfile
import threading
import time
from importlib.util import find_spec
from multiprocessing.connection import Connection, Listener
from typing import Any

from tactibench import UserError
from tactibench_tactip.errors import RobotError, RobotLostError
from tactibench_tactip.robots.base import missing_package

STARTED_S = 10.0
END_S = 3.0
STALE_S, MOST_STALE_S = 0.5, 1.0
"""Least and greatest host seconds for which facts hold, and for which new facts are then awaited.
In between it is a period of the watchdog, which is longer in a rehearsal, where emulators share the
processor. The greatest is less than the time after which a move is given up for another reason."""


class UrLink:
    """A connection that starts the process, and keeps the facts that it sends at 125 Hz.

    The arm has neither watchdog nor TCP until it is asked to ``prepare``.

    Args:
        host: Address of the controller.
        tcp: TCP to set, m and a rotation vector, rad.
        watchdog_hz: Rate of the watchdog.
        seconds: Time within which the arm must answer.

    Attributes:
        tcp_before: The controller's own TCP, m and a rotation vector, rad.

    Raises:
        RobotError: The process does not start, or the arm does not answer in time.
        UserError: The package ur_rtde is missing, or the arm refuses the connection.
    """

    def __init__(self, host: str, tcp: list[float], watchdog_hz: float, seconds: float) -> None:
        if find_spec("rtde_control") is None:
            raise missing_package(
                "ur_rtde", "ur", " (it has no wheel for Python 3.13: take Python 3.11 or 3.12)"
            )
        self._host = host
        self._news = threading.Condition()
        self._facts: dict[str, Any] = {}
        self._answers: dict[int, dict[str, Any]] = {}
        self._orders = 0
        self._stale_s = min(MOST_STALE_S, max(STALE_S, 1.0 / watchdog_hz))
        self._after = 0
        self._changed_at, self._stamp = 0.0, -1.0
        self._ended, self._last = False, ""
        self._link = self._start()
        first = {"host": host, "tcp": tcp, "watchdog_hz": watchdog_hz}
        try:
            self._link.send_bytes(json.dumps(first).encode())
            if not self._link.poll(seconds):
                raise RobotError(
                    f"the UR at {host} did not answer within {seconds:g} s; check that it is "
                    "switched on and that nothing else controls it."
                )
            reply = self._receive()
        except (EOFError, OSError):
            reply = {"failed": "the process that talks to it ended"}
        except BaseException:
            self.close()
            raise
        if "failed" in reply:
            self.close()
            raise UserError(
                f"the UR at {host} refuses the connection ({reply['failed']}); where a fieldbus "
                "uses its registers switch that off, and end other programs that control the arm."
            )
        self.tcp_before: list[float] = reply["tcp"]
        threading.Thread(target=self._listen, name="tactip ur", daemon=True).start()

    def ask(self, what: str, *given: Any, wait_s: float = 8.0) -> str:
        """Have the process call a method of ``Arm``; return what went wrong, or "".

        Args:
            what: Name of the method.
            given: Its arguments.
            wait_s: Time to wait for the answer.

        Raises:
            RobotLostError: The process ended, or does not answer in time.
        """
        with self._news:
            self._orders += 1
            number = self._orders
        try:
            message = {"do": what, "with": given, "number": number}
            self._link.send_bytes(json.dumps(message).encode())
        except OSError:
            raise RobotLostError(self._lost()) from None
        end = time.monotonic() + wait_s
        with self._news:
            while number not in self._answers:
                left = end - time.monotonic()
                if self._ended or left <= 0:
                    raise RobotLostError(self._lost())
                self._news.wait(left)
            answer = self._answers.pop(number)
            self._after = answer["facts"]
        return str(answer["answer"])

    def facts(self) -> dict[str, Any]:
        """Return the latest facts, which are newer than the last answer.

        Raises:
            RobotLostError: No new facts come, or the connection to the controller is lost.
        """
        end = time.monotonic() + self._stale_s
        with self._news:
            while not self._fresh():
                left = end - time.monotonic()
                if self._ended or left <= 0:
                    raise RobotLostError(self._lost())
                self._news.wait(left)
            if self._ended or not self._facts["linked"]:
                raise RobotLostError(self._lost())
            return self._facts

    def _fresh(self) -> bool:
        """Return whether the facts are newer than the last answer, and not too old."""
        newer = bool(self._facts) and self._facts["number"] > self._after
        return newer and time.monotonic() - self._changed_at <= self._stale_s

    def close(self) -> None:
        """End the process, which stops the arm.

        A process that hangs is killed; the controller's watchdog then stops the arm.
        """
        if self._link is not None:
            self._link.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(END_S)
        self._last = self._last_word()
        self._stderr.close()

    def _start(self) -> Connection:
        key = secrets.token_hex(16).encode()
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115 - as long as the process lives
        with Listener(("127.0.0.1", 0), authkey=key) as listener:
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    "tactibench_tactip.robots.ur_worker",
                    str(listener.address[1]),
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._stderr,
                # Ctrl-C is for this process, which stops the arm in order. A session of its own
                # would do, too, but the kernel shares the processor between sessions, and starves
                # it under load.
                process_group=0,
            )
            assert self._process.stdin is not None  # noqa: S101
            self._process.stdin.write(key + b"\n")
            self._process.stdin.close()
            accepted: list[Connection] = []
            waiter = threading.Thread(
                target=lambda: accepted.append(listener.accept()), daemon=True
            )
            waiter.start()
            waiter.join(STARTED_S)
        if not accepted:
            self._process.kill()
            raise RobotError("the process that talks to the UR did not start.")
        return accepted[0]

    def _receive(self) -> dict[str, Any]:
        message: dict[str, Any] = json.loads(self._link.recv_bytes())
        return message

    def _listen(self) -> None:
        try:
            while True:
                message = self._receive()
                with self._news:
                    if "to" in message:
                        self._answers[message["to"]] = message
                    else:
                        if message["time"] != self._stamp:
                            self._stamp, self._changed_at = message["time"], time.monotonic()
                        self._facts = message
                    self._news.notify_all()
        except (EOFError, OSError, ValueError, TypeError):
            with self._news:
                self._ended = True
                self._news.notify_all()

    def _lost(self) -> str:
        return (
            f"the controller at {self._host} sends nothing any more ({self._last_word()}); check "
            "the network cable. Its watchdog stops the arm."
        )

    def _last_word(self) -> str:
        """Return the last line that the process of the arm wrote to stderr."""
        if self._stderr.closed:
            return self._last
        self._stderr.seek(0)
        lines = self._stderr.read().decode("utf-8", "replace").splitlines()
        return next((line.strip() for line in reversed(lines) if line.strip()), "no word")
