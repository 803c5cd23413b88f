"""A stage behind a GRBL 1.1 controller; every wait for an answer has an end.

Every move is a jog (``$J=``): a jog leaves the parser's modes alone, is refused in words where it
would leave the travel, and can be cancelled at once with its position kept, so that the tool can be
retracted afterwards. (A feed hold and reset, the other way to stop, loses the position.) A jog says
how far to go, not where: whatever the controller has forgotten, the tool moves no farther. G91 is
its last word, because a controller that is reset in the middle of a line takes the rest of the line
for G-code, and goes at once where that says.

The position is not known after a reset, an alarm, or without the offset of what is reported. It is
known where this program homed the stage since its controller started: a mark says so, which a reset
erases. That the stage is not locked proves nothing: somebody may have unlocked it, and grblHAL need
not lock it at all.
"""

from __future__ import annotations

import math
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
    PositionUnknownError,
    Purpose,
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
SAME_MM = 0.02
"""Difference of two reports of one place: they are rounded to 0.001 mm, and a step is 0.01."""
TURN_DEG = 0.05
"""Turns above this are refused: a stage of three axes cannot turn."""
_RATES = {"x": "$110", "y": "$111", "z": "$112"}
_NEEDED = {
    "$13": (0.0, "reports in mm"),
    "$20": (1.0, "soft limits"),
    "$22": (None, "homing"),
    **{key: (None, f"top speed of {axis}") for axis, key in _RATES.items()},
}
"""Setting -> the value that it must have, and its meaning."""
MARK = "F47110"
"""A feed that nobody uses: it marks that the stage was homed, until a reset sets the feed to 0."""
HOMES = 1
"""Bit of $22 that says that a stage homes."""
_CANCEL, _RESET, _HOLD = b"\x85", b"\x18", b"!"
ANSWER_S = 2.0
"""Longest wait for the answer to a line, which GRBL gives when it has parsed it."""
STATUS_S = 0.25
"""Time after which a status report is requested again: a busy GRBL drops the request."""
PAUSE_S = 0.0005
"""Pause between two looks at a port without data: without it they would take a whole core."""
MODES, MODES_HEAD = b"$G\n", "[GC:"
"""A question, and the head of its answer, which no other line has; GRBL answers it also while it
moves."""
HARMLESS = b"$\n"
"""A line that asks for help. Behind the rest of a line that lay in the controller's buffer it makes
one that is refused, where an empty line would run that rest."""
_NUMBERS = re.compile(r"-?\d+(?:\.\d+)?")
_BANNER = re.compile(r"Grbl(HAL)? \d")
_SETTING = re.compile(r"(\$\d+)=(-?\d+(?:\.\d+)?)(?=\s|$)")

_ERRORS = {
    8: "it is not idle",
    9: "it is locked by an alarm",
    10: "soft limits need homing",
    15: "the target is beyond the stage's travel",
}
_ALARMS = {
    1: "a limit switch was hit",
    2: "a target beyond the stage's travel",
    3: "it was reset while it moved",
    **dict.fromkeys(range(6, 11), "homing failed"),
}


class NoAnswerError(RobotError):
    """GRBL did not answer in time."""


@dataclass(frozen=True)
class Status:
    """A status report.

    Attributes:
        state: Idle, Run, Hold, Jog, Alarm, Door, Check, Home, Sleep.
        position: Position of the machine, mm; None: the report does not tell it.
    """

    state: str
    position: tuple[float, float, float] | None


class GrblLink:
    """A connection to GRBL; its methods raise RobotLostError where the port goes away.

    Attributes:
        alarm: Number of the latest alarm, 0: none.
        banner: Line that the controller sends when it starts.
        unknown: Reason why the position is not known; "": it is known.
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
        self._offset: tuple[float, float, float] | None = None
        self.last = Status("", None)
        self.alarm = 0
        self.banner = self.unknown = ""
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
            PositionUnknownError: A reset or an alarm came instead of an answer.
        """
        before = self.unknown
        if self._late:
            self.read_modes()
        self.drain()
        if not before:
            self.check_known()
        self.send(line.encode() + b"\n")
        lines: list[str] = []
        end = time.monotonic() + wait_s
        while time.monotonic() < end:
            while (answer := self._next_line()) is not None:
                if answer == "ok":
                    return lines
                if answer.startswith("error:"):
                    if self.unknown != before:  # a reset cut the line
                        self.check_known()
                    meaning = describe_error(answer)
                    raise RobotError(f"GRBL refuses {line!r}: {answer} ({meaning}).")
                lines.append(answer)
                self._note(answer)
                if not before:
                    self.check_known()
            time.sleep(PAUSE_S)
        self._late = True
        if self.unknown != before:
            self.check_known()
        raise NoAnswerError(f"GRBL did not answer {line!r} within {wait_s:g} s.")

    def read_modes(self, wait_s: float = ANSWER_S) -> str:
        """Return the modes of the parser, ``[GC:...]``, and skip all answers to lines before.

        Raises:
            NoAnswerError: GRBL does not answer within ``wait_s``.
            PositionUnknownError: A reset or an alarm came instead.
        """
        self.send(MODES)
        end, modes, before = time.monotonic() + wait_s, "", self.unknown
        self._late = True
        while time.monotonic() < end:
            line = self._next_line()
            if line is None:
                time.sleep(PAUSE_S)
            elif modes and line == "ok":
                self._late = False
                return modes
            else:
                modes = line if line.startswith(MODES_HEAD) else modes
                self._note(line)
                if not before:
                    self.check_known()
        raise NoAnswerError(
            "GRBL's answers come too late or not at all; check the cable, and home the stage."
        )

    def check_known(self) -> None:
        """Raise PositionUnknownError where the position is not known."""
        if self.unknown:
            raise PositionUnknownError(
                f"the position of the stage is not known: {self.unknown}. Look where the tool is, "
                "clear its way, and run `tactibench hw jog --home`."
            )

    def status(self, wait_s: float = ANSWER_S) -> Status:
        """Return state and position.

        A report of work positions tells the position once their offset was reported, which is in
        every tenth report.

        Raises:
            NoAnswerError: GRBL tells no position within ``wait_s``.
        """
        self.drain()
        if self.alarm:  # GRBL may answer no more
            return self.last
        before, end = self.last, time.monotonic() + wait_s
        while time.monotonic() < end:
            self.send(b"?")
            sent, asked = time.monotonic(), self.last
            while self.last is asked and time.monotonic() < min(end, sent + STATUS_S):
                while (line := self._next_line()) is not None:
                    self._note(line)
                    if (self.last is not before and self.last.position) or self.alarm:
                        return self.last
                time.sleep(PAUSE_S)
        raise NoAnswerError(
            f"GRBL told no position within {wait_s:g} s; look at the stage, and set $10=1 where it "
            "reports work positions."
        )

    def send(self, data: bytes) -> None:
        """Send bytes, such as a character that is acted on at once and not answered."""
        try:
            self._port.write(data)
        except self._errors as error:
            raise _lost(error) from None

    def wait_banner(self, wait_s: float) -> None:
        """Wait for the first ``Grbl`` banner, at most ``wait_s``; each later one is a reset."""
        end = time.monotonic() + wait_s
        while time.monotonic() < end and not self.banner:
            self.drain()
            time.sleep(0.002)
        self.unknown = "it was not asked yet"

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

        The position is MPos, or WPos plus the last offset that was reported since the start.
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
        if position is None and "WPos" in values and self._offset is not None:
            x, y, z = (w + o for w, o in zip(values["WPos"], self._offset, strict=True))
            position = (x, y, z)
        return Status(state.partition(":")[0], position)

    def _note(self, line: str) -> None:
        status = self.parse_status(line)
        if status is not None:
            self.last = status
            if status.state == "Alarm":
                self.unknown = self.unknown or "it is locked by an alarm, as before it is homed"
        elif line.startswith("ALARM:"):
            numbers = _NUMBERS.findall(line)
            self.alarm = int(numbers[0]) if numbers else -1
            self.last = replace(self.last, state="Alarm")
            self.unknown = describe_alarm(self.alarm)
        elif _BANNER.search(line):
            self.banner, self._offset = line, None
            self.unknown = f"its controller was reset, for it says {line!r}"

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
        self._rest: tuple[float, float, float] | None = None
        self._moving = self._homing = self._moves = False
        self.at_switches = False

    def connect(self, purpose: Purpose = "move") -> None:
        """Open the port, check the stage's settings, and home it where that is asked for.

        Raises:
            UserError: The port does not answer as GRBL, or a setting does not fit the
                configuration.
            PositionUnknownError: The stage is to move, and may not be homed.
            RobotError: The stage fails.
        """
        address = self._robot.address
        link = self._open_link = GrblLink(address)
        link.wait_banner(BANNER_SOCKET_S if address.startswith("socket://") else BANNER_S)
        for _ in range(2):  # it may start only now
            link.send(HARMLESS)
            with suppress(NoAnswerError):
                link.read_modes()
                break
        else:
            raise UserError(
                f"nothing at {address} answers as GRBL 1.1 does; check that it is the stage's port "
                "and runs at 115200 baud."
            )
        versions: list[str] = []
        with suppress(RobotError):  # $I needs an idle controller
            versions = [line for line in link.command("$I") if line.startswith("[VER")]
        self._version = versions[0] if versions else link.banner
        for _ in range(2):  # an answer may be damaged on its way
            with suppress(NoAnswerError):
                self._settings |= _parse_settings(link.command("$$"))
            if self._settings.keys() >= _NEEDED.keys():
                break
        self._check_settings()
        link.unknown = ""
        self._check_mark()
        link.status()
        self._moves = purpose != "look"
        if purpose == "home" or (purpose == "move" and link.unknown and self._robot.home):
            self.home()
        if purpose != "look":
            link.check_known()

    def home(self) -> None:
        """Drive to the switches; meanwhile GRBL answers nothing but a reset.

        Where a stage has none, a person says by this that its position is right.

        Raises:
            RobotError: GRBL refuses, or does not answer within HOMING_S.
        """
        link = self._link
        link.drain()
        link.alarm, link.unknown, self._homing = 0, "", self._homes
        try:
            link.command("$H" if self._homes else "$X", HOMING_S)
            link.command(f"{MARK}G21G94")
        except RobotError:
            link.unknown = link.unknown or "it could not be homed"
            raise
        self._homing, self._polled_at, self.at_switches = False, 0.0, self._homes

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:  # noqa: ARG002
        """Begin a jog; the acceleration is the stage's own."""
        turn = angle_between(pose, self._work_frame)
        if turn > TURN_DEG:
            raise RobotError(f"the stage cannot turn, but was to turn by {turn:.1f} deg.")
        link = self._link
        self._check_mark()  # after late answers, so that nothing moves once the place was read
        place = self._read_place()
        if link.last.state != "Idle":
            raise RobotError(f"the stage is not at rest, but in state {link.last.state}.")
        x, y, z = (b - a for a, b in zip(place, pose[:3], strict=True))
        self._rest = None
        link.command(f"$J=X{x:.4f}Y{y:.4f}Z{z:.4f}F{60 * speed:.1f}G21G91")
        self._moving, self._polled_at, self.at_switches = True, 0.0, False

    def moving(self) -> bool:
        """Return whether the jog goes on."""
        if self._moving:
            self._moving = self._status().state not in ("Idle", "Alarm", "Sleep", "Hold", "Door")
            self._link.check_known()
        return self._moving

    def pose(self) -> Pose6:
        """Return the pose of the tool; at rest it comes from a new report."""
        place = self._known_place(self._status()) if self._moving else self._read_place()
        return *place, *self._work_frame[3:]

    def _check_mark(self) -> None:
        """Note that the position is not known where the mark is gone, in two answers."""
        if not any(re.search(rf"\b{MARK}\b", self._link.read_modes()) for _ in range(2)):
            reason = "its controller was not told where it is since it started"
            self._link.unknown = self._link.unknown or reason

    def _read_place(self) -> tuple[float, float, float]:
        """Return the place of a new report; at rest the report before must tell it, too.

        A jog from a wrong place would go a wrong way: a report may be damaged, and a reset may go
        unnoticed where the line that tells it is.
        """
        link, before = self._link, self._rest
        place = self._known_place(link.status())
        for _ in range(2):
            if link.last.state != "Idle" or (before and math.dist(before, place) <= SAME_MM):
                break
            before, place = place, self._known_place(link.status())
        expected = self._rest or before
        self._rest = place if link.last.state == "Idle" else None
        if expected and math.dist(expected, place) > SAME_MM:
            link.unknown = "it says another place than before, and nothing moved it"
            link.check_known()
        return place

    def _known_place(self, status: Status) -> tuple[float, float, float]:
        self._link.check_known()
        assert status.position is not None, "status tells one, or a reason"  # noqa: S101
        return status.position

    def stop(self) -> None:
        """Cancel the jog."""
        self._link.send(_CANCEL)
        self._moving, self._polled_at = True, 0.0

    def state(self) -> RobotState:
        """Return whether GRBL would move."""
        self._link.drain()
        status = self._status()
        self._link.check_known()
        if status.state in ("Idle", "Jog"):
            return RobotState(normal=True, description=status.state)
        description = f"GRBL is in state {status.state}: somebody paused it, or something else runs"
        return RobotState(normal=False, description=description)

    def close(self) -> None:
        """Stop all motion and close the port."""
        if self._open_link is None:
            return
        with suppress(RobotError):
            if self._moves:
                self._link.send(_CANCEL)
            # A reset erases the mark, too: nobody takes a lost position for a known one later.
            if self._homing or (self._moves and self._link.unknown):
                self._link.send(_HOLD + _RESET)
        self._link.close()

    def describe(self) -> dict[str, str]:
        """Return the firmware's version and the settings of motion."""
        keys = ("$10", "$13", "$20", "$21", "$22", *_RATES.values())
        settings = {key: f"{self._settings[key]:g}" for key in keys if key in self._settings}
        return {"driver": "grbl", "version": self._version, **settings}

    @property
    def _link(self) -> GrblLink:
        assert self._open_link is not None, "connected"  # noqa: S101
        return self._open_link

    def _status(self) -> Status:
        """Return the last report, or a new one where that is older than POLL_S."""
        if time.monotonic() - self._polled_at > POLL_S or self._link.last.position is None:
            self._link.status()
            self._polled_at = time.monotonic()
        return self._link.last

    @property
    def _homes(self) -> bool:
        return bool(int(self._settings.get("$22", HOMES)) & HOMES)

    def _check_settings(self) -> None:
        settings, robot = self._settings, self._robot
        for key, (value, meaning) in _NEEDED.items():
            told = settings.get(key)
            if told is None and key not in robot.lacks:
                raise UserError(
                    f"the stage does not tell its setting {key} ({meaning}); where its firmware "
                    f'has no such setting, check that by hand and write robot.lacks = ["{key}"].'
                )
            if not (
                None in (told, value) or told == value or (key == "$20" and robot.allow_unhomed)
            ):
                raise UserError(f"the stage has {key}={told:g}; set {key}={value:g} ({meaning}).")
        fastest = max(robot.approach_mm_s, robot.press_mm_s, robot.retract_mm_s)
        for axis, key in _RATES.items():
            most = settings.get(key, math.inf) / 60.0
            if fastest > most + 1e-6:
                raise UserError(
                    f"the configuration asks for {fastest:g} mm/s, but axis {axis} of the stage "
                    f"reaches {most:.1f} mm/s ({key}={settings[key]:g} mm/min); lower the speeds "
                    "in [robot]."
                )
        if not (self._homes or robot.allow_unhomed):
            raise UserError(
                f"the stage does not home ($22={settings['$22']:g}), so its position is not known; "
                "fit switches and set $22=1, or say robot.allow_unhomed = true and set its zero by "
                "hand."
            )


def _parse_settings(lines: list[str]) -> dict[str, float]:
    found = (_SETTING.match(line) for line in lines)
    return {match[1]: float(match[2]) for match in found if match}
