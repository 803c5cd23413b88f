"""The dashboard server of a UR, and the words of its safety status.

Spoken here directly: ``DashboardClient`` of ur_rtde hides why a connection fails.
"""

from __future__ import annotations

import re
import socket
import time

from tactibench import UserError
from tactibench_tactip.errors import RobotError

PORT = 29999
ANSWER_S = 2.5
RUNNING = 7
"""Of the robot mode: switched on, brakes released."""
NORMAL, REDUCED, PROTECTIVE = 0, 1, 2
STOP_BITS = {
    2: "protective stop",
    3: "recovery mode",
    4: "safeguard stop",
    5: "emergency stop of the system",
    6: "emergency stop of the robot",
    7: "emergency stop",
    8: "safety violation",
    9: "safety fault",
    11: "three-position switch active",
}
"""Safety status bits that keep the arm from moving (RTDE guide)."""
MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "safety has to be confirmed",
    2: "booting",
    3: "power off",
    4: "power on",
    5: "idle, brakes on",
    6: "backdrive",
    RUNNING: "running",
}
_VERSION = re.compile(r"(\d+)\.(\d+)")


def is_normal(bits: int) -> bool:
    """Return whether the arm may be moved: normal or reduced, and nothing else set."""
    return bool(bits & (1 << NORMAL | 1 << REDUCED)) and not _stops(bits)


def is_protective_stop(bits: int) -> bool:
    """Return whether a protective stop is all that is wrong."""
    return _stops(bits) == [PROTECTIVE]


def describe_safety(bits: int, mode: int) -> str:
    """Return everything that keeps the arm from moving; its mode when nothing does."""
    reasons = [STOP_BITS[bit] for bit in _stops(bits)]
    if mode != RUNNING:
        reasons.append(MODES.get(mode, f"robot mode {mode}"))
    return ", ".join(reasons) or ("reduced" if bits >> REDUCED & 1 else "normal")


def _stops(bits: int) -> list[int]:
    return [bit for bit in STOP_BITS if bits >> bit & 1]


class Dashboard:
    """One connection. Raises UserError when there is none to be had."""

    def __init__(self, host: str) -> None:
        self.version = ""
        try:
            self._socket = socket.create_connection((host, PORT), ANSWER_S)
            self._rest = b""
            self._read_line()  # it greets
        except OSError as error:
            raise UserError(
                f"nothing at {host}:{PORT} answers as a UR does ({error.strerror or error}); check "
                "that it is switched on, that robot.address is its address and that the dashboard "
                "server is enabled (Settings, Security, Services)."
            ) from None

    def ask(self, question: str) -> str:
        """Return the answer to a line. Raises RobotError without one."""
        try:
            self._socket.sendall(question.encode() + b"\n")
            return self._read_line()
        except OSError as error:
            raise RobotError(
                f"the dashboard of the UR did not answer {question!r} ({error.strerror or error})."
            ) from None

    def check_ready(self) -> None:
        """Raise UserError for a UR that is off, stopped, or in local mode; it says what to do."""
        self.version = self.ask("PolyscopeVersion")
        match = _VERSION.search(self.version)
        version = (int(match[1]), int(match[2])) if match else (0, 0)
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
        """Release a protective stop, again and again until ``end`` of ``time.monotonic``.

        The controller refuses for the first seconds. Raises RobotError.
        """
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
        """Close the connection."""
        self._socket.close()

    def _read_line(self) -> str:
        while b"\n" not in self._rest:
            data = self._socket.recv(4096)
            if not data:
                raise ConnectionResetError("closed by the controller")
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode("utf-8", "replace").strip()
