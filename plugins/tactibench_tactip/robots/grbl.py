"""A stage behind a GRBL 1.1 controller.

Every move is a jog (``$J=``): a jog leaves the parser's modes alone, is refused in words where it
would leave the travel, and can be cancelled at once with its position kept, so that the tool can be
retracted afterwards. (A feed hold and reset, the other way to stop, loses the position.)
"""

from __future__ import annotations

import time
from contextlib import suppress

from tactibench import UserError
from tactibench_tactip.errors import NotHomedError, RobotError, RobotLostError
from tactibench_tactip.poses import angle_between
from tactibench_tactip.robots.base import HOMING_S, ProbingRobot, Robot, RobotState
from tactibench_tactip.robots.grbl_link import GrblLink, NoAnswerError, Status, describe_alarm
from tactibench_tactip.settings import Pose6, Settings

BANNER_S, BANNER_SOCKET_S = 2.5, 0.2
"""An Arduino is reset when its port is opened and takes 2 s to start; a socket resets nothing."""
PROBE_S = 60.0
"""Longest time of a probing move: GRBL answers only when it has ended."""
POLL_S = 0.1
"""Device seconds between two status reports; GRBL wants no more than 5 to 10 a second."""
TURN_DEG = 0.05
"""Turns above this are refused: a stage of three axes cannot turn."""
_RATES = {"x": "$110", "y": "$111", "z": "$112"}
_CANCEL, _RESET, _HOLD = b"\x85", b"\x18", b"!"


class GrblRobot(Robot, ProbingRobot):
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
        self._last = Status("", (0.0, 0.0, 0.0))
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

    def probe(self, pose: Pose6, speed: float) -> Pose6 | None:
        """Move towards a pose until the probe's circuit closes (``G38.3``); None: it did not.

        The move is relative: probing knows work coordinates only, whose offset is not set here.

        Raises:
            RobotError: GRBL refuses, raises an alarm or does not answer.
        """
        start = self.pose()
        x, y, z = (to - now for to, now in zip(pose[:3], start[:3], strict=True))
        command = f"G21G91G38.3X{x:.4f}Y{y:.4f}Z{z:.4f}F{60 * speed:.1f}"
        lines = self._link.command(command, PROBE_S)
        if self._link.alarm:
            raise RobotError(f"the probe failed: GRBL {describe_alarm(self._link.alarm)}.")
        self._link.command("G90")
        self._polled_at = 0.0
        report = next((line for line in lines if line.startswith("[PRB:")), "")
        place, _, closed = report.strip("[]").removeprefix("PRB:").partition(":")
        if closed != "1":
            return None
        px, py, pz = (float(value) for value in place.split(","))
        return self._with_turn(px, py, pz)

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
        """Return the last report, or a new one where that is older than POLL_S, device seconds."""
        if time.monotonic() - self._polled_at > POLL_S / self._robot.time_scale:
            self._last = self._link.status()
            self._polled_at = time.monotonic()
        return self._last

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
