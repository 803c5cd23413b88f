"""The dashboard server of a UR: lines of text that say and change the controller's state.

Spoken here directly: ``DashboardClient`` of ur_rtde hides why a connection fails.
"""

from __future__ import annotations

import re
import socket
import time

from tactibench import UserError
from tactibench_tactip.failures import RobotError

PORT = 29999
ANSWER_S = 2.5
_VERSION = re.compile(r"(\d+)\.(\d+)")


class Dashboard:
    """One connection. Raises UserError when there is none to be had."""

    def __init__(self, host: str) -> None:
        self._host = host
        self.version = ""
        try:
            self._socket = socket.create_connection((host, PORT), ANSWER_S)
            self._rest = b""
            self._line()  # it greets
        except OSError as error:
            raise UserError(
                f"nothing at {host}:{PORT} answers as a UR does ({error.strerror or error}); check "
                "that it is switched on, that robot.address is its address and that the dashboard "
                "server is enabled (Settings, Security, Services)."
            ) from None

    def ask(self, question: str) -> str:
        """The answer of a line. Raises RobotError without one."""
        try:
            self._socket.sendall(question.encode() + b"\n")
            return self._line()
        except OSError as error:
            raise RobotError(
                f"the dashboard of the UR did not answer {question!r} ({error.strerror or error})."
            ) from None

    def demand_ready(self) -> None:
        """Raises UserError for a UR that is off, stopped, or in local mode; it says what to do."""
        self.version = self.ask("PolyscopeVersion")
        found = _VERSION.search(self.version)
        version = (int(found[1]), int(found[2])) if found else (0, 0)
        if version >= (5, 6) and "true" not in self.ask("is in remote control").lower():
            raise UserError(
                "the UR is in local mode; switch it to remote control at the top right of the "
                "pendant (enable that first under Settings, System, Remote Control)."
            )
        safety = self.ask("safetystatus").rpartition(":")[2].strip()
        if safety not in ("NORMAL", "REDUCED"):
            raise UserError(
                f"the UR's safety status is {safety}; look at the arm, release the stop on the "
                "pendant, and start again."
            )
        mode = self.ask("robotmode").rpartition(":")[2].strip()
        if mode != "RUNNING":
            raise UserError(
                f"the UR is in robot mode {mode}; switch it on and release the brakes on the "
                "pendant."
            )

    def unlock(self, end: float, pause_s: float) -> None:
        """Release a protective stop, again and again until ``end`` of ``time.monotonic``: the
        controller refuses for the first seconds. Raises RobotError."""
        self.ask("close safety popup")
        while True:
            answer = self.ask("unlock protective stop")
            if "releasing" in answer.lower():
                return
            if time.monotonic() > end:
                raise RobotError(
                    f"the UR does not release its protective stop ({answer}); look at the arm and "
                    "do it on the pendant."
                )
            time.sleep(pause_s)

    def close(self) -> None:
        self._socket.close()

    def _line(self) -> str:
        while b"\n" not in self._rest:
            data = self._socket.recv(4096)
            if not data:
                raise ConnectionResetError("closed by the controller")
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode("utf-8", "replace").strip()
