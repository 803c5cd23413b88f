"""A stage behind a GRBL 1.1 controller.

Every move is a jog (``$J=``): a jog leaves the parser's modes alone, is refused in words where it
would leave the travel, and can be cancelled at once with its position kept, so that the tool can be
retracted afterwards. (A feed hold and reset, the other way to stop, loses the position.)
"""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any

from tactibench import UserError
from tactibench_tactip.failures import RobotError, RobotLostError
from tactibench_tactip.geometry.frames import turned_by
from tactibench_tactip.robots.base import HOMING_S, RobotState
from tactibench_tactip.robots.grbl_link import GrblLink, NoAnswerError, Status, alarm_words
from tactibench_tactip.settings import Pose6, Settings

BANNER_S = 2.5
POLL_S = 0.1
"""Between status reports, device seconds; GRBL wants no more than 5 to 10 a second."""
_AXES = (("x", "$110", "$120"), ("y", "$111", "$121"), ("z", "$112", "$122"))
_TOLD = ("$13", "$20", "$21", "$22")
_CANCEL, _RESET, _HOLD = b"\x85", b"\x18", b"!"


class GrblRobot:
    """The machine's coordinates are the base frame; the stage carries the tool without turning it,
    so every pose has the work frame's own orientation. ``tcp_pose`` does not count."""

    turns = False

    def __init__(self, settings: Settings) -> None:
        self._keys = settings.robot
        self._frames = settings.frames
        self._link: Any = None
        self._settings: dict[str, float] = {}
        self._last: Status | None = None
        self._asked = 0.0
        self._moving = self._homing = False
        self.at_switches = False

    def connect(self) -> None:
        link = GrblLink(self._keys.address)
        self._link = link
        link.wait_banner(BANNER_S if not self._keys.address.startswith("socket://") else 0.2)
        try:
            link.command("")
        except NoAnswerError:
            raise UserError(
                f"nothing at {self._keys.address} answers as GRBL 1.1 does; check that it is the "
                "stage's port and runs at 115200 baud."
            ) from None
        try:
            version = [line for line in link.command("$I") if line.startswith("[VER")]
        except RobotError:  # $I needs an idle controller, $$ as well
            version = []
        self._version = version[0] if version else link.banner
        self._settings = _settings_of(self._command_patiently("$$"))
        self._verify()
        self._demand_homed()

    def home(self) -> None:
        """Drive to the switches, where GRBL answers nothing but a reset. Raises RobotError."""
        self._link.alarm, self._homing = 0, True
        self._link.command("$H", HOMING_S)
        self._homing, self._asked, self.at_switches = False, 0.0, True

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:  # noqa: ARG002
        turn = turned_by(pose, self._frames.work_frame)
        if turn > 0.05:
            raise RobotError(f"the stage cannot turn, but was to turn by {turn:.1f} deg.")
        x, y, z = pose[:3]
        try:
            self._link.command(f"$J=G53G90G21X{x:.4f}Y{y:.4f}Z{z:.4f}F{60 * speed:.1f}")
        except NoAnswerError:  # lost on its way: whoever moves sees whether it was done
            self._link.status()
        self._moving, self._asked, self.at_switches = True, 0.0, False

    def moving(self) -> bool:
        if self._moving:
            self._moving = self._status().state not in ("Idle", "Alarm", "Sleep", "Hold", "Door")
        return self._moving

    def pose(self) -> Pose6:
        if not self._moving:
            self._asked = 0.0
        x, y, z = self._status().position
        a, b, c = self._frames.work_frame[3:]
        return x, y, z, a, b, c

    def stop(self) -> None:
        self._link.realtime(_CANCEL)
        self._moving, self._asked = True, 0.0

    def state(self) -> RobotState:
        self._link.drain()
        status = self._status()
        if self._link.alarm or status.state == "Alarm":
            words = alarm_words(self._link.alarm) if self._link.alarm else "locked by an alarm"
            return RobotState(normal=False, words=f"GRBL {words}")
        if status.state in ("Hold", "Door", "Sleep", "Check"):
            words = f"GRBL is in state {status.state}, somebody at the stage paused it"
            return RobotState(normal=False, words=words)
        return RobotState(normal=True, words=status.state)

    def tick(self) -> None:
        """GRBL has no watchdog; moves are short."""

    def probe(self, pose: Pose6, speed: float) -> Pose6 | None:
        """``G38.3``: towards a pose until the probe's circuit closes; None: it did not.

        Relative: a probe knows work coordinates only, whose offset is not ours.
        """
        here = self.pose()
        x, y, z = (to - now for to, now in zip(pose[:3], here[:3], strict=True))
        probe = f"G21G91G38.3X{x:.4f}Y{y:.4f}Z{z:.4f}F{60 * speed:.1f}"
        lines = self._link.command(probe, 60.0)
        if self._link.alarm:
            raise RobotError(f"the probe failed: GRBL {alarm_words(self._link.alarm)}.")
        self._link.command("G90")
        self._asked = 0.0
        report = next((line for line in lines if line.startswith("[PRB:")), "")
        place, _, met = report.strip("[]").removeprefix("PRB:").partition(":")
        if met != "1":
            return None
        px, py, pz = (float(value) for value in place.split(","))
        a, b, c = self._frames.work_frame[3:]
        return px, py, pz, a, b, c

    def close(self) -> None:
        if self._link is None:
            return
        with suppress(RobotError):
            if self._homing or self._under_way():
                self._link.realtime(_HOLD)
                self._link.realtime(_RESET)
        self._link.close()

    def _under_way(self) -> bool:
        """Whether it may still move; a stage that says nothing may when it did."""
        try:
            return self._link.status(0.3).state in ("Run", "Jog", "Hold", "Home")
        except NoAnswerError:
            return self._moving

    def describe(self) -> dict[str, str]:
        told = {
            key: f"{value:g}"
            for key, value in sorted(self._settings.items())
            if key in _TOLD or key[1:].startswith(("11", "12", "13"))
        }
        return {"driver": "grbl", "version": self._version, **told}

    def _status(self) -> Status:
        """The last report, a new one when it is older than POLL_S of the device's time."""
        now = time.monotonic()
        if self._last is None or now - self._asked > POLL_S / self._keys.time_scale:
            self._last = self._link.status()
            self._asked = time.monotonic()
        return self._last

    def _command_patiently(self, line: str) -> list[str]:
        """One more try: an answer may have been damaged on its way."""
        try:
            return list(self._link.command(line))
        except NoAnswerError:
            return list(self._link.command(line))

    def _verify(self) -> None:
        found = self._settings
        for key, wanted, why in (
            ("$13", 0.0, "reports are in mm"),
            ("$20", 1.0, "soft limits are on"),
        ):
            if key == "$20" and self._keys.allow_unhomed:
                continue
            if found.get(key) != wanted:
                raise UserError(
                    f"the stage has {key}={found.get(key, float('nan')):g}; set {key}={wanted:g} "
                    f"so that {why}."
                )
        keys = self._keys
        fastest = max(keys.approach_mm_s, keys.press_mm_s, keys.retract_mm_s)
        for axis, rate, _ in _AXES:
            most = found.get(rate, 0.0) / 60.0
            if fastest > most + 1e-6:
                raise UserError(
                    f"the configuration asks for {fastest:g} mm/s, but axis {axis} of the stage "
                    f"reaches {most:.1f} mm/s ({rate}={found.get(rate, 0.0):g} mm/min); lower the "
                    "speeds in [robot]."
                )

    def _demand_homed(self) -> None:
        switches = self._settings.get("$22") == 1.0
        if not switches:
            if not self._keys.allow_unhomed:
                raise UserError(
                    "the stage does not home ($22=0), so nobody knows where it is; fit switches "
                    "and set $22=1, or say robot.allow_unhomed = true and set its zero by hand."
                )
            return
        if self._link.status().state != "Alarm":
            return
        if not self._keys.home:
            raise UserError(
                "the stage is not homed; clear its way and run `tactibench hw jog --home`, or say "
                "robot.home = true to let it home whenever it is connected."
            )
        self.home()


def _settings_of(lines: list[str]) -> dict[str, float]:
    found = {}
    for line in lines:
        key, equals, value = line.partition("=")
        if key.startswith("$") and equals:
            try:
                found[key] = float(value)
            except ValueError:
                raise RobotLostError(f"GRBL's setting {line!r} is damaged; try again.") from None
    return found
