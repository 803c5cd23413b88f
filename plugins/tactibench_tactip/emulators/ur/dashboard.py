"""One dashboard connection: lines in, lines out (UR: Dashboard Server e-Series)."""

from __future__ import annotations

from collections.abc import Callable

from tactibench_tactip.emulators.ur.controller import PLAYING, POWER_OFF, RUNNING, Controller

GREETING = b"Connected: Universal Robots Dashboard Server\n"
REFUSED = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective "
    "stop before unlocking"
)
LOCAL = "Command is not allowed in local control mode"
_LONGEST = 4096


class DashboardSession:
    """serial: digits of the serial number."""

    def __init__(self, controller: Controller, serial: str) -> None:
        self._controller, self._serial = controller, serial
        self._waiting = b""
        self.over = False

    def feed(self, data: bytes, t: float) -> bytes:
        """Answers to the lines that are whole. Raises ValueError for an endless line."""
        self._waiting += data
        out = b""
        while b"\n" in self._waiting and not self.over:
            line, _, self._waiting = self._waiting.partition(b"\n")
            out += self._answer(line.decode("latin-1").strip(), t).encode() + b"\n"
        if len(self._waiting) > _LONGEST:
            raise ValueError("a line of the dashboard has no end")
        return out

    def _answer(self, line: str, t: float) -> str:
        c, asked = self._controller, line.lower()
        reads: dict[str, Callable[[], str]] = {
            "polyscopeversion": lambda: f"URSoftware {'.'.join(map(str, c.version))} (Mar 24 2022)",
            "version": lambda: "{}.{}.{}.{}".format(*c.version),
            "get serial number": lambda: self._serial,
            "get robot model": lambda: "UR5",
            "is in remote control": lambda: str(c.remote).lower(),
            "safetystatus": lambda: f"Safetystatus: {c.safety}",
            "safetymode": lambda: f"Safetymode: {c.safety}",
            "robotmode": lambda: (
                f"Robotmode: {'RUNNING' if c.robot_mode == RUNNING else 'POWER_OFF'}"
            ),
            "programstate": lambda: f"{self._state()} tactibench.urp",
            "running": lambda: f"Program running: {str(c.runtime_state == PLAYING).lower()}",
            "get loaded program": lambda: "No program loaded",
            "close popup": lambda: "closing popup",
            "close safety popup": lambda: "closing safety popup",
            "quit": self._quit,
        }
        acts: dict[str, Callable[[], str]] = {
            "stop": lambda: self._stop(t),
            "pause": lambda: "Failed to execute: pause",
            "play": lambda: "Failed to execute: play",
            "unlock protective stop": lambda: self._unlock(t),
            "power on": self._power_on,
            "power off": lambda: self._power_off(t),
            "brake release": lambda: "Brake releasing",
            "restart safety": lambda: "Restarting safety",
        }
        if asked in reads:
            return reads[asked]()
        if asked in acts:
            return acts[asked]() if c.remote else LOCAL
        if asked.startswith("popup "):
            return "showing popup"
        if asked.startswith("addtolog "):
            c.messages.append(line[9:])
            return "Added log message"
        return f'could not understand: "{line}"'

    def _state(self) -> str:
        return "PLAYING" if self._controller.runtime_state == PLAYING else "STOPPED"

    def _quit(self) -> str:
        self.over = True
        return "Disconnected"

    def _stop(self, t: float) -> str:
        self._controller.end_program(t)
        return "Stopped"

    def _unlock(self, t: float) -> str:
        return "Protective stop releasing" if self._controller.unlock(t) else REFUSED

    def _power_on(self) -> str:
        if self._controller.safety == "NORMAL":
            self._controller.robot_mode = RUNNING
        return "Powering on"

    def _power_off(self, t: float) -> str:
        self._controller.end_program(t)
        self._controller.robot_mode = POWER_OFF
        return "Powering off"
