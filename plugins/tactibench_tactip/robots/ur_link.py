"""The process that holds a UR, from the side that tells it what to do."""

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
from tactibench_tactip.failures import RobotError, RobotLostError
from tactibench_tactip.robots.connect import missing

STARTED_S = 10.0
END_S = 3.0
STALE_S, MOST_STALE_S = 0.5, 1.0
"""Host seconds for which facts are true, and for which new ones are waited for then; a period of
the watchdog where that is longer (a rehearsal's: emulators share the processor), but less than the
time after which a move is given up for another reason."""


class UrLink:
    """Facts come at 125 Hz and are kept; ``ask`` waits for an answer, for so long."""

    def __init__(self, host: str, tcp: list[float], watchdog_hz: float, seconds: float) -> None:
        if find_spec("rtde_control") is None:
            raise missing(
                "ur_rtde", "ur", " (it has no wheel for Python 3.13: take Python 3.11 or 3.12)"
            )
        self._host = host
        self._news = threading.Condition()
        self._facts: dict[str, Any] = {}
        self._answers: dict[int, dict[str, Any]] = {}
        self._asked = 0
        self._stale_s = min(MOST_STALE_S, max(STALE_S, 1.0 / watchdog_hz))
        self._after = 0
        self._changed_at, self._stamp = 0.0, -1.0
        self._ended = self._last = ""
        self._link = self._start()
        first = {"host": host, "tcp": tcp, "watchdog_hz": watchdog_hz}
        try:
            self._link.send_bytes(json.dumps(first).encode())
            if not self._link.poll(seconds):
                raise RobotError(
                    f"the UR at {host} did not answer within {seconds:g} s; check that it is "
                    "switched on and that nothing else controls it."
                )
            told = self._told()
        except (EOFError, OSError):
            told = {"failed": "the process that talks to it ended"}
        except BaseException:
            self.close()
            raise
        if "failed" in told:
            self.close()
            raise UserError(
                f"the UR at {host} refuses the connection ({told['failed']}); where a fieldbus "
                "uses its registers switch that off, and end other programs that control the arm."
            )
        threading.Thread(target=self._listen, name="tactip ur", daemon=True).start()

    def ask(self, what: str, *given: Any, wait_s: float = 8.0) -> str:
        """Have something done; what went wrong, "" when nothing. Raises RobotLostError."""
        with self._news:
            self._asked += 1
            number = self._asked
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
        """The latest, newer than the last answer. Raises RobotLostError when none come."""
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
        """Whether there are facts that are newer than the last answer, and not long ago."""
        there = bool(self._facts) and self._facts["number"] > self._after
        return there and time.monotonic() - self._changed_at <= self._stale_s

    def close(self) -> None:
        """End the process: it stops the arm. One that hangs is ended by force; the controller's
        watchdog stops the arm then."""
        if self._link is not None:
            self._link.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(END_S)
        self._last = self._last_word()
        self._said.close()

    def _start(self) -> Connection:
        key = secrets.token_hex(16).encode()
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - as long as the process lives
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
                stderr=self._said,
                start_new_session=True,  # Ctrl-C is for us: the arm is stopped in order
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

    def _told(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self._link.recv_bytes())
        return found

    def _listen(self) -> None:
        try:
            while True:
                told = self._told()
                with self._news:
                    if "to" in told:
                        self._answers[told["to"]] = told
                    else:
                        if told["time"] != self._stamp:
                            self._stamp, self._changed_at = told["time"], time.monotonic()
                        self._facts = told
                    self._news.notify_all()
        except (EOFError, OSError, ValueError, TypeError):
            with self._news:
                self._ended = "ended"
                self._news.notify_all()

    def _lost(self) -> str:
        return (
            f"the controller at {self._host} sends nothing any more ({self._last_word()}); check "
            "the network cable. Its watchdog stops the arm."
        )

    def _last_word(self) -> str:
        """Of the process that holds the arm."""
        if self._said.closed:
            return self._last
        self._said.seek(0)
        lines = self._said.read().decode("utf-8", "replace").splitlines()
        return next((line.strip() for line in reversed(lines) if line.strip()), "no word")
