"""Lines to and from a GRBL 1.1 controller: send one, wait for its answer, never for ever."""

from __future__ import annotations

import re
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from tactibench import UserError
from tactibench_tactip.failures import RobotError, RobotLostError
from tactibench_tactip.robots.connect import missing

ANSWER_S = 2.0
CRITICAL = (1, 2)
"""Alarms after which nothing is answered before a reset."""
_NUMBERS = re.compile(r"-?\d+(?:\.\d+)?")


@dataclass(frozen=True)
class Status:
    """state: Idle, Run, Hold, Jog, Alarm, Door, Check, Home, Sleep. position: machine's, mm."""

    state: str
    position: tuple[float, float, float]


class GrblLink:
    """One port. Raises RobotLostError when it goes away."""

    def __init__(self, address: str) -> None:
        try:
            import serial
        except ImportError:
            raise missing("pyserial", "serial") from None
        self._errors: tuple[type[Exception], ...] = (serial.SerialException, OSError)
        self._offset = (0.0, 0.0, 0.0)
        self._position = (0.0, 0.0, 0.0)
        self.alarm = 0
        self.banner = ""
        self.pushed: list[str] = []
        self._rest = b""
        try:
            self._port: Any = serial.serial_for_url(
                address, 115200, timeout=0, write_timeout=2, do_not_open=True
            )
            self._port.dtr = False  # a falling DTR resets an Arduino
            if not address.startswith("socket://"):
                self._port.exclusive = True
            self._port.open()
        except (ValueError, *self._errors) as error:
            raise UserError(
                f"the serial port {address} cannot be opened ({error}); check robot.address and "
                "that no other program holds it."
            ) from None

    def command(self, line: str, wait_s: float = ANSWER_S) -> list[str]:
        """Send a line and return what came before its ``ok``.

        Raises RobotError for an error, an alarm, or no answer.
        """
        self.drain()
        self._write(line.encode() + b"\n")
        lines: list[str] = []
        end = time.monotonic() + wait_s
        while True:
            for got in self._lines():
                if got == "ok":
                    return lines
                if got.startswith("error:"):
                    raise RobotError(f"GRBL refuses {line!r}: {got} ({meaning(got)}).")
                lines.append(got)
                self._note(got)
            if time.monotonic() > end:
                raise NoAnswerError(f"GRBL did not answer {line!r} within {wait_s:g} s.")
            time.sleep(0.0005)

    def status(self, wait_s: float = ANSWER_S) -> Status:
        """Ask for state and position. Raises RobotError without an answer."""
        self.drain()
        if self.alarm in CRITICAL:
            return Status("Alarm", self._position)
        end = time.monotonic() + wait_s
        while time.monotonic() < end:
            self._write(b"?")
            asked = time.monotonic()
            while time.monotonic() < min(end, asked + 0.25):
                for got in self._lines():
                    found = self._status(got)
                    if found is not None:
                        self._position = found.position
                        return found
                    self._note(got)
                    if self.alarm:  # a critical one ends its answers
                        return Status("Alarm", self._position)
                time.sleep(0.0005)
        raise NoAnswerError(f"GRBL gave no status within {wait_s:g} s; look at the stage.")

    def realtime(self, byte: bytes) -> None:
        """Send a character that is acted on at once and not answered."""
        self._write(byte)

    def wait_banner(self, wait_s: float) -> bool:
        """Whether a ``Grbl`` banner came in that time."""
        end = time.monotonic() + wait_s
        while time.monotonic() < end and not self.banner:
            self.drain()
            time.sleep(0.002)
        return bool(self.banner)

    def drain(self) -> None:
        """Take in what was pushed unasked."""
        for got in self._lines():
            self._note(got)

    def close(self) -> None:
        with suppress(Exception):  # gone is gone
            self._port.close()

    def _note(self, line: str) -> None:
        self.pushed = [*self.pushed[-20:], line]
        if line.startswith("ALARM:"):
            numbers = _NUMBERS.findall(line)
            self.alarm = int(numbers[0]) if numbers else -1
        elif line.startswith("Grbl"):
            self.banner = line

    def _status(self, line: str) -> Status | None:
        """MPos, or WPos and the last offset that was told; None: no whole status."""
        if not (line.startswith("<") and line.endswith(">")):
            return None
        state, *fields = line[1:-1].split("|")
        values = {}
        for field in fields:
            name, _, text = field.partition(":")
            numbers = text.split(",")
            if name in ("MPos", "WPos", "WCO"):
                try:
                    x, y, z = (float(number) for number in numbers[:3])
                except ValueError:
                    return None
                values[name] = (x, y, z)
        self._offset = values.get("WCO", self._offset)
        if "MPos" in values:
            return Status(state.partition(":")[0], values["MPos"])
        if "WPos" in values:
            x, y, z = (w + o for w, o in zip(values["WPos"], self._offset, strict=True))
            return Status(state.partition(":")[0], (x, y, z))
        return None

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except self._errors as error:
            raise self._lost(error) from None

    def _lines(self) -> list[str]:
        try:
            data = self._port.read(4096)
        except self._errors as error:
            raise self._lost(error) from None
        if not data:
            return []
        *whole, self._rest = (self._rest + data).split(b"\n")
        texts = (line.decode("ascii", "replace").strip() for line in whole)
        return [text for text in texts if text]

    @staticmethod
    def _lost(error: Exception) -> RobotLostError:
        return RobotLostError(
            f"the serial port went away ({error}); check the cable and home the stage."
        )


class NoAnswerError(RobotError):
    """GRBL is silent."""


_ERRORS = {
    5: "homing is switched off, $22",
    8: "it is not idle",
    9: "it is locked by an alarm",
    10: "soft limits need homing",
    15: "the target is beyond the stage's travel",
    22: "no feed rate",
    33: "a wrong target",
}
_ALARMS = {
    1: "a limit switch was hit, the position is lost; home the stage",
    2: "a target beyond the stage's travel; the position is kept",
    3: "it was reset while it moved, the position is lost; home the stage",
    4: "the probe was closed before it started",
    5: "the probe met nothing",
}


def meaning(answer: str) -> str:
    """Of ``error:N``, in words."""
    number = _NUMBERS.findall(answer)
    return _ERRORS.get(int(number[0]), "see the list of GRBL 1.1") if number else "damaged"


def alarm_words(number: int) -> str:
    """Of an alarm, in words."""
    words = _ALARMS.get(number)
    if words is None:
        words = "homing failed" if 6 <= number <= 10 else "see the list of GRBL 1.1"
    return f"alarm {number}: {words}"
