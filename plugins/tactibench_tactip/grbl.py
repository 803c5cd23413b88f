"""A stage behind a GRBL 1.1 controller; every wait for an answer has an end.

Every move is a jog (``$J=``): a jog leaves the parser's modes alone, is refused in words where it
would leave the travel, and can be cancelled at once with its position kept, so that the tool can be
retracted afterwards. (A feed hold and reset, the other way to stop, loses the position.)
"""

from __future__ import annotations

import re
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from tactibench import UserError
from tactibench_tactip.geometry import angle_between
from tactibench_tactip.robots import (
    HOMING_S,
    NotHomedError,
    Robot,
    RobotError,
    RobotLostError,
    RobotState,
    missing_package,
)
from tactibench_tactip.settings import Pose6, Settings

BANNER_S, BANNER_SOCKET_S = 2.5, 0.2
"""An Arduino is reset when its port is opened and takes 2 s to start; a socket resets nothing."""
POLL_S = 0.1
"""Time between two status reports; GRBL wants no more than 5 to 10 a second."""
TURN_DEG = 0.05
"""Turns above this are refused: a stage of three axes cannot turn."""
_RATES = {"x": "$110", "y": "$111", "z": "$112"}
_CANCEL, _RESET, _HOLD = b"\x85", b"\x18", b"!"
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
        last: The last status report; its state is Alarm as soon as an alarm was sent.
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
        # A TypeError: pyserial reads from no file where another thread closed its port meanwhile.
        self._errors: tuple[type[Exception], ...] = (serial.SerialException, OSError, TypeError)
        self._offset = (0.0, 0.0, 0.0)
        self.last = Status("", (0.0, 0.0, 0.0))
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
            return self.last
        before, end = self.last, time.monotonic() + wait_s
        while time.monotonic() < end:
            self._write(b"?")
            sent = time.monotonic()
            while time.monotonic() < min(end, sent + STATUS_S):
                while (line := self._next_line()) is not None:
                    self._note(line)
                    # After a critical alarm GRBL answers no more.
                    if self.last is not before or self.alarm:
                        return self.last
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
        status = self.parse_status(line)
        if status is not None:
            self.last = status
        elif line.startswith("ALARM:"):
            numbers = _NUMBERS.findall(line)
            self.alarm = int(numbers[0]) if numbers else -1
            self.last = replace(self.last, state="Alarm")
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


class GrblRobot(Robot):
    """A stage whose machine coordinates are the base frame.

    It carries the tool without turning it, so every pose has the work frame's own orientation.
    ``tcp_pose`` is not used.
    """

    turns = False

    def __init__(self, settings: Settings) -> None:
        self._robot = settings.robot
        self._work_frame = settings.frames.work_frame
        self._open_link: GrblLink | None = None
        self._settings: dict[str, float] = {}
        self._version = ""
        self._polled_at = 0.0
        self._moving = self._homing = False
        self.at_switches = False

    def connect(self) -> None:
        """Open the port, check the stage's settings, and home it where ``robot.home`` says so.

        Raises:
            UserError: The port does not answer as GRBL, or a setting does not fit the
                configuration.
            NotHomedError: The stage is not homed; all else is as it should be.
            RobotError: The stage fails.
        """
        address = self._robot.address
        link = self._open_link = GrblLink(address)
        link.wait_banner(BANNER_SOCKET_S if address.startswith("socket://") else BANNER_S)
        try:
            link.command("")
        except NoAnswerError:
            raise UserError(
                f"nothing at {address} answers as GRBL 1.1 does; check that it is the stage's port "
                "and runs at 115200 baud."
            ) from None
        try:
            versions = [line for line in link.command("$I") if line.startswith("[VER")]
        except RobotError:  # $I needs an idle controller
            versions = []
        self._version = versions[0] if versions else link.banner
        try:
            lines = link.command("$$")
        except NoAnswerError:  # the answer may have been damaged on its way
            lines = link.command("$$")
        self._settings = _parse_settings(lines)
        self._check_settings()
        self._check_homed()

    def home(self) -> None:
        """Drive to the switches; meanwhile GRBL answers nothing but a reset.

        Raises:
            RobotError: GRBL refuses, or does not answer within HOMING_S.
        """
        self._link.alarm, self._homing = 0, True
        self._link.command("$H", HOMING_S)
        self._homing, self._polled_at, self.at_switches = False, 0.0, True

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:  # noqa: ARG002
        """Begin a jog; the acceleration is the stage's own."""
        turn = angle_between(pose, self._work_frame)
        if turn > TURN_DEG:
            raise RobotError(f"the stage cannot turn, but was to turn by {turn:.1f} deg.")
        x, y, z = pose[:3]
        try:
            self._link.command(f"$J=G53G90G21X{x:.4f}Y{y:.4f}Z{z:.4f}F{60 * speed:.1f}")
        except NoAnswerError:  # the answer was lost: the caller sees whether it moves
            self._link.status()
        self._moving, self._polled_at, self.at_switches = True, 0.0, False

    def moving(self) -> bool:
        """Return whether the jog goes on."""
        if self._moving:
            self._moving = self._status().state not in ("Idle", "Alarm", "Sleep", "Hold", "Door")
        return self._moving

    def pose(self) -> Pose6:
        """Return the pose of the tool; at rest it comes from a new report."""
        if not self._moving:
            self._polled_at = 0.0
        return self._with_turn(*self._status().position)

    def stop(self) -> None:
        """Cancel the jog."""
        self._link.realtime(_CANCEL)
        self._moving, self._polled_at = True, 0.0

    def state(self) -> RobotState:
        """Return whether GRBL would move."""
        self._link.drain()
        status = self._status()
        alarm = self._link.alarm
        if alarm or status.state == "Alarm":
            description = describe_alarm(alarm) if alarm else "locked by an alarm"
            return RobotState(normal=False, description=f"GRBL {description}")
        if status.state in ("Hold", "Door", "Sleep", "Check"):
            description = f"GRBL is in state {status.state}, somebody at the stage paused it"
            return RobotState(normal=False, description=description)
        return RobotState(normal=True, description=status.state)

    def close(self) -> None:
        """Stop all motion and close the port."""
        if self._open_link is None:
            return
        with suppress(RobotError):
            if self._homing or self._may_move():
                self._link.realtime(_HOLD)
                self._link.realtime(_RESET)
        self._link.close()

    def describe(self) -> dict[str, str]:
        """Return the firmware's version and the settings of motion."""
        settings = {
            key: f"{value:g}"
            for key, value in sorted(self._settings.items())
            if key in ("$13", "$20", "$21", "$22") or key[1:].startswith(("11", "12", "13"))
        }
        return {"driver": "grbl", "version": self._version, **settings}

    @property
    def _link(self) -> GrblLink:
        assert self._open_link is not None, "connected"  # noqa: S101
        return self._open_link

    def _may_move(self) -> bool:
        """Return whether the stage may still move; a silent stage may where it moved before."""
        try:
            return self._link.status(0.3).state in ("Run", "Jog", "Hold", "Home")
        except NoAnswerError:
            return self._moving

    def _with_turn(self, x: float, y: float, z: float) -> Pose6:
        return x, y, z, *self._work_frame[3:]

    def _status(self) -> Status:
        """Return the last report, or a new one where that is older than POLL_S."""
        if time.monotonic() - self._polled_at > POLL_S:
            self._link.status()
            self._polled_at = time.monotonic()
        return self._link.last

    def _check_settings(self) -> None:
        settings = self._settings
        needed = [("$13", 0.0, "reports are in mm")]
        if not self._robot.allow_unhomed:
            needed.append(("$20", 1.0, "soft limits are on"))
        for key, value, why in needed:
            if key not in settings:
                raise UserError(
                    f"the stage did not tell its setting {key}; run it again, and check the cable."
                )
            if settings[key] != value:
                raise UserError(
                    f"the stage has {key}={settings[key]:g}; set {key}={value:g} so that {why}."
                )
        robot = self._robot
        fastest = max(robot.approach_mm_s, robot.press_mm_s, robot.retract_mm_s)
        for axis, key in _RATES.items():
            most = settings.get(key, 0.0) / 60.0
            if fastest > most + 1e-6:
                raise UserError(
                    f"the configuration asks for {fastest:g} mm/s, but axis {axis} of the stage "
                    f"reaches {most:.1f} mm/s ({key}={settings.get(key, 0.0):g} mm/min); lower the "
                    "speeds in [robot]."
                )

    def _check_homed(self) -> None:
        if self._settings.get("$22") != 1.0:
            if not self._robot.allow_unhomed:
                raise UserError(
                    "the stage does not home ($22=0), so its position is not known; fit switches "
                    "and set $22=1, or say robot.allow_unhomed = true and set its zero by hand."
                )
            return
        if self._link.status().state != "Alarm":
            return
        if not self._robot.home:
            raise NotHomedError(
                "the stage is not homed, so its position is not known; clear its way and run "
                "`tactibench hw jog --home` (a stage that forgets it when its port is opened needs "
                "robot.home = true: every command that moves it then homes it first)."
            )
        self.home()


def _parse_settings(lines: list[str]) -> dict[str, float]:
    settings = {}
    for line in lines:
        key, equals, value = line.partition("=")
        if key.startswith("$") and equals:
            try:
                settings[key] = float(value)
            except ValueError:
                raise RobotLostError(f"GRBL's setting {line!r} is damaged; try again.") from None
    return settings
