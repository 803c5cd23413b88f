"""Lines to and from a GRBL 1.1 controller; every wait for an answer has an end."""

from __future__ import annotations

import re
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from tactibench import UserError
from tactibench_tactip.errors import RobotError, RobotLostError
from tactibench_tactip.robots.base import missing_package

ANSWER_S = 2.0
"""Longest wait for the answer to a line, which GRBL gives when it has parsed it."""
STATUS_S = 0.25
"""Time after which a status report is requested again: a busy GRBL drops the request."""
PAUSE_S = 0.0005
"""Pause between two looks at a port without data: without it they would take a whole core."""
STATE, STATE_HEAD = "$G", "[GC:"
"""A question, and the head of its answer, which no other line has; GRBL answers it also while it
moves."""
CRITICAL = (1, 2)
"""Alarms after which nothing is answered before a reset."""
_NUMBERS = re.compile(r"-?\d+(?:\.\d+)?")

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
    **dict.fromkeys(range(6, 11), "homing failed"),
}


class NoAnswerError(RobotError):
    """GRBL did not answer in time."""


@dataclass(frozen=True)
class Status:
    """A status report.

    Attributes:
        state: Idle, Run, Hold, Jog, Alarm, Door, Check, Home, Sleep.
        position: Position of the machine, mm.
    """

    state: str
    position: tuple[float, float, float]


class GrblLink:
    """A connection to GRBL; its methods raise RobotLostError where the port goes away.

    Attributes:
        alarm: Number of the latest alarm, 0: none.
        banner: Line that the controller sends when it starts.
    """

    def __init__(self, address: str) -> None:
        """Open the port.

        Args:
            address: A serial port or socket://.

        Raises:
            UserError: The package pyserial is missing, or the port cannot be opened.
        """
        try:
            import serial
        except ImportError:
            raise missing_package("pyserial", "serial") from None
        self._errors: tuple[type[Exception], ...] = (serial.SerialException, OSError)
        self._offset = self._position = (0.0, 0.0, 0.0)
        self.alarm = 0
        self.banner = ""
        self._rest = b""
        self._lines: deque[str] = deque()
        self._late = False
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

        An answer that comes too late is not taken for that of a later line.

        Raises:
            RobotError: GRBL answers with an error.
            NoAnswerError: GRBL does not answer within ``wait_s``.
        """
        if self._late:
            self._resynchronise()
        self.drain()
        self._write(line.encode() + b"\n")
        lines: list[str] = []
        end = time.monotonic() + wait_s
        while True:
            while (answer := self._next_line()) is not None:
                if answer == "ok":
                    return lines
                if answer.startswith("error:"):
                    meaning = describe_error(answer)
                    raise RobotError(f"GRBL refuses {line!r}: {answer} ({meaning}).")
                lines.append(answer)
                self._note(answer)
            if time.monotonic() > end:
                self._late = True
                raise NoAnswerError(f"GRBL did not answer {line!r} within {wait_s:g} s.")
            time.sleep(PAUSE_S)

    def _resynchronise(self) -> None:
        """Skip late answers, up to the answer to a question that no other line answers.

        Raises:
            RobotLostError: That answer does not come within ANSWER_S.
        """
        self._write(STATE.encode() + b"\n")
        end = time.monotonic() + ANSWER_S
        state_seen = False
        while time.monotonic() < end:
            line = self._next_line()
            if line is None:
                time.sleep(PAUSE_S)
            elif state_seen and line == "ok":
                self._late = False
                return
            else:
                state_seen = state_seen or line.startswith(STATE_HEAD)
                self._note(line)
        raise RobotLostError(
            "GRBL's answers come too late or not at all; check the cable, and home the stage."
        )

    def status(self, wait_s: float = ANSWER_S) -> Status:
        """Return state and position.

        Raises:
            NoAnswerError: GRBL gives no status within ``wait_s``.
        """
        self.drain()
        if self.alarm in CRITICAL:
            return Status("Alarm", self._position)
        end = time.monotonic() + wait_s
        while time.monotonic() < end:
            self._write(b"?")
            sent = time.monotonic()
            while time.monotonic() < min(end, sent + STATUS_S):
                while (line := self._next_line()) is not None:
                    status = self.parse_status(line)
                    if status is not None:
                        self._position = status.position
                        return status
                    self._note(line)
                    if self.alarm:  # after a critical alarm GRBL answers no more
                        return Status("Alarm", self._position)
                time.sleep(PAUSE_S)
        raise NoAnswerError(f"GRBL gave no status within {wait_s:g} s; look at the stage.")

    def realtime(self, byte: bytes) -> None:
        """Send a character that is acted on at once and not answered."""
        self._write(byte)

    def wait_banner(self, wait_s: float) -> None:
        """Wait for the ``Grbl`` banner, at most ``wait_s``."""
        end = time.monotonic() + wait_s
        while time.monotonic() < end and not self.banner:
            self.drain()
            time.sleep(0.002)

    def drain(self) -> None:
        """Read the lines that GRBL sent unrequested, such as an alarm."""
        while (line := self._next_line()) is not None:
            self._note(line)

    def close(self) -> None:
        """Close the port. Never raises."""
        with suppress(Exception):  # the port may be gone already
            self._port.close()

    def parse_status(self, line: str) -> Status | None:
        """Return the status of a line; None: it is no complete status report.

        The position is MPos, or WPos plus the last reported offset.
        """
        if not (line.startswith("<") and line.endswith(">")):
            return None
        state, *fields = line[1:-1].split("|")
        values = {}
        for field in fields:
            name, _, text = field.partition(":")
            if name in ("MPos", "WPos", "WCO"):
                try:
                    x, y, z = (float(number) for number in text.split(",")[:3])
                except ValueError:
                    return None
                values[name] = (x, y, z)
        self._offset = values.get("WCO", self._offset)
        position = values.get("MPos")
        if position is None and "WPos" in values:
            x, y, z = (w + o for w, o in zip(values["WPos"], self._offset, strict=True))
            position = (x, y, z)
        return None if position is None else Status(state.partition(":")[0], position)

    def _note(self, line: str) -> None:
        if line.startswith("ALARM:"):
            numbers = _NUMBERS.findall(line)
            self.alarm = int(numbers[0]) if numbers else -1
        elif line.startswith("Grbl"):
            self.banner = line

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except self._errors as error:
            raise _lost(error) from None

    def _next_line(self) -> str | None:
        """Return the oldest line that was not read yet; None: there is none."""
        if not self._lines:
            self._lines.extend(self._read_lines())
        return self._lines.popleft() if self._lines else None

    def _read_lines(self) -> list[str]:
        try:
            data = self._port.read(4096)
        except self._errors as error:
            raise _lost(error) from None
        if not data:
            return []
        *complete, self._rest = (self._rest + data).split(b"\n")
        texts = (line.decode("ascii", "replace").strip() for line in complete)
        return [text for text in texts if text]


def describe_error(answer: str) -> str:
    """Return the meaning of ``error:N``."""
    number = _NUMBERS.findall(answer)
    return _ERRORS.get(int(number[0]), "see the list of GRBL 1.1") if number else "damaged"


def describe_alarm(number: int) -> str:
    """Return an alarm's number and meaning."""
    return f"alarm {number}: {_ALARMS.get(number, 'see the list of GRBL 1.1')}"


def _lost(error: Exception) -> RobotLostError:
    return RobotLostError(
        f"the serial port went away ({error}); check the cable and home the stage."
    )
