"""A UR arm through ``ur_rtde``, which runs in a process of its own.

Moves are asynchronous and bounded: ``moveUntilContact`` has no limit of travel (and does nothing on
CB3), and a blocking ``moveL`` beside a watchdog kick loses the handshake that ends it.
"""

from __future__ import annotations

import re
import socket
import time

from tactibench import UserError
from tactibench_tactip.errors import ProtectiveStopError, RobotError
from tactibench_tactip.poses import angle_between, distance_between, from_ur, to_ur
from tactibench_tactip.robots.base import RecoverableRobot, Robot, RobotState
from tactibench_tactip.robots.ur_link import UrLink
from tactibench_tactip.settings import Pose6, Settings

GRACE_S = 1.5
"""Host seconds after which a move counts as ended, where the arm stands short of its target and the
controller reports no move."""
NEAR_MM, NEAR_DEG = 0.05, 0.1
"""Distance and angle within which two poses are the same."""
TCP_MM, TCP_DEG = 0.5, 0.5
"""Difference that the pendant's TCP may have from the configuration's: a TCP is taught as exactly
as this."""
RECOVERY_S = 15.0
RELOAD_S = 2.0
UNLOCK_AFTER_S = 5.0
"""The controller refuses to unlock a protective stop within 5 s of it."""
PORT = 29999
ANSWER_S = 2.5
RUNNING = 7
"""Robot mode: switched on, brakes released."""
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


class UrRobot(Robot, RecoverableRobot):
    """A UR arm; the base frame is the controller's, the TCP that of the configuration."""

    turns = True

    def __init__(self, settings: Settings) -> None:
        self._settings = settings.robot
        self._tcp = settings.frames.tcp_pose
        self._open_link: UrLink | None = None
        self._dashboard: Dashboard | None = None
        self._closed = False
        self._target: Pose6 | None = None
        self._rest_pose: Pose6 = (0.0,) * 6
        self._rest_since = 0.0

    def connect(self) -> None:
        """Connect to the arm.

        Raises:
            UserError: The arm is not there, is not ready, or has another TCP than the
                configuration.
            RobotError: The arm does not answer in time, or cannot be prepared.
        """
        settings = self._settings
        self._dashboard = Dashboard(settings.address)
        self._dashboard.check_ready()
        self._open_link = UrLink(
            settings.address, to_ur(self._tcp), settings.watchdog_hz, settings.connect_s
        )
        if self._closed:  # the caller no longer waits
            self._open_link.close()
            return
        self._check_tcp(from_ur(self._open_link.tcp_before))
        self._check(self._open_link.ask("prepare"))

    def _check_tcp(self, before: Pose6) -> None:
        """Raise UserError where the pendant's TCP is another, which may be a mistake of a file."""
        distance, angle = distance_between(before, self._tcp), angle_between(before, self._tcp)
        if self._settings.set_tcp or (distance <= TCP_MM and angle <= TCP_DEG):
            return
        pendant, ours = (", ".join(f"{v:.1f}" for v in pose) for pose in (before, self._tcp))
        raise UserError(
            f"the UR's TCP is {pendant} (mm, deg), frames.tcp_pose says {ours}; correct the one "
            "that is wrong (pendant: Installation, General, TCP), or say robot.set_tcp = true to "
            "use frames.tcp_pose whatever the pendant has."
        )

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        """Begin a straight move."""
        self._check(self._link.ask("start", to_ur(pose), 1e-3 * speed, 1e-3 * acceleration))
        self._target = pose
        self._note_rest(self.pose())

    def moving(self) -> bool:
        """Return whether the move goes on.

        For a short while a move also goes on until the arm has reached its target: the controller
        reports a move only a little after its beginning.
        """
        pose = self.pose()
        if self._link.facts()["moving"]:
            self._note_rest(pose)
            return True
        if self._target is None or _same(pose, self._target):
            return False
        if not _same(pose, self._rest_pose):
            self._note_rest(pose)
        return time.monotonic() - self._rest_since < GRACE_S

    def pose(self) -> Pose6:
        """Return the pose of the tool."""
        return from_ur(self._link.facts()["pose"])

    def stop(self) -> None:
        """Brake the arm."""
        self._target = None
        self._check(self._link.ask("stop"))

    def state(self) -> RobotState:
        """Return the state, from the safety status, the mode and the program."""
        facts = self._link.facts()
        bits, mode = facts["bits"], facts["mode"]
        normal, description = is_normal(bits) and mode == RUNNING, describe_safety(bits, mode)
        if normal and not facts["program"]:
            normal = False
            description = "its control program ended (watchdog, pendant or another client)"
        fx, fy, fz = facts["force"]
        return RobotState(
            normal,
            f"the UR says: {description}",
            is_protective_stop(bits),
            (fx, fy, fz),
            facts["time"],
        )

    def recover(self) -> None:
        """Release a protective stop: wait, unlock, load the program again.

        Raises:
            RobotError: The stop is of another kind, or the controller refuses.
        """
        assert self._dashboard is not None, "connected"  # noqa: S101
        facts = self._link.facts()
        if not is_protective_stop(facts["bits"]):
            description = describe_safety(facts["bits"], facts["mode"])
            raise RobotError(f"only a protective stop is released; the UR says: {description}.")
        time.sleep(UNLOCK_AFTER_S / self._settings.time_scale)
        end = time.monotonic() + RECOVERY_S
        self._dashboard.unlock(end, 1.0 / self._settings.time_scale)
        while not is_normal(self._link.facts()["bits"]):
            if time.monotonic() > end:
                raise RobotError("the protective stop was not released; do it on the pendant.")
            time.sleep(0.01)
        self._check(self._link.ask("reload", RELOAD_S, wait_s=RECOVERY_S))
        self._target = None

    def close(self) -> None:
        """Let go of the arm, which stops."""
        self._closed = True
        if self._open_link is not None:
            self._open_link.close()
        if self._dashboard is not None:
            self._dashboard.close()

    def describe(self) -> dict[str, str]:
        """Return the controller's version, and the pendant's speed slider."""
        version = "" if self._dashboard is None else self._dashboard.version
        facts = {"driver": "ur", "polyscope": version}
        if self._open_link is not None:
            facts["speed_slider"] = f"{100 * self._open_link.facts()['slider']:.0f} %"
        return facts

    @property
    def _link(self) -> UrLink:
        assert self._open_link is not None, "connected"  # noqa: S101
        return self._open_link

    def _note_rest(self, pose: Pose6) -> None:
        self._rest_pose, self._rest_since = pose, time.monotonic()

    def _check(self, problem: str) -> None:
        if not problem:
            return
        state = self.state()
        kind = ProtectiveStopError if state.stopped else RobotError
        raise kind(f"the UR refuses: {problem} ({state.description}).")


class Dashboard:
    """A connection to the dashboard server.

    Its protocol is spoken here directly, because ``DashboardClient`` of ur_rtde hides why a
    connection fails.

    Raises:
        UserError: Nothing at the host answers as the dashboard of a UR does.
    """

    def __init__(self, host: str) -> None:
        self.version = ""
        try:
            self._socket = socket.create_connection((host, PORT), ANSWER_S)
            self._rest = b""
            self._read_line()  # the server sends a greeting first
        except OSError as error:
            raise UserError(
                f"nothing at {host}:{PORT} answers as a UR does ({error.strerror or error}); check "
                "that it is switched on, that robot.address is its address and that the dashboard "
                "server is enabled (Settings, Security, Services)."
            ) from None

    def ask(self, question: str) -> str:
        """Return the answer to a line.

        Raises:
            RobotError: The dashboard does not answer.
        """
        try:
            self._socket.sendall(question.encode() + b"\n")
            return self._read_line()
        except OSError as error:
            raise RobotError(
                f"the dashboard of the UR did not answer {question!r} ({error.strerror or error})."
            ) from None

    def check_ready(self) -> None:
        """Raise UserError where the UR is off, stopped or in local mode; it says what to do."""
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
        """Try to release a protective stop, again and again; the controller refuses at first.

        Args:
            end: ``time.monotonic`` up to which it is tried.
            pause_s: Host seconds between two attempts.

        Raises:
            RobotError: The stop was not released, or the dashboard does not answer.
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


def is_normal(bits: int) -> bool:
    """Return whether the arm may be moved: normal or reduced, and nothing else set."""
    return bool(bits & (1 << NORMAL | 1 << REDUCED)) and not _stops(bits)


def is_protective_stop(bits: int) -> bool:
    """Return whether a protective stop is the only reason that keeps the arm from moving."""
    return _stops(bits) == [PROTECTIVE]


def describe_safety(bits: int, mode: int) -> str:
    """Return everything that keeps the arm from moving, or "normal" or "reduced".

    Args:
        bits: Safety status bits.
        mode: Robot mode.
    """
    reasons = [STOP_BITS[bit] for bit in _stops(bits)]
    if mode != RUNNING:
        reasons.append(MODES.get(mode, f"robot mode {mode}"))
    return ", ".join(reasons) or ("reduced" if bits >> REDUCED & 1 else "normal")


def _stops(bits: int) -> list[int]:
    return [bit for bit in STOP_BITS if bits >> bit & 1]


def _same(a: Pose6, b: Pose6) -> bool:
    return distance_between(a, b) < NEAR_MM and angle_between(a, b) < NEAR_DEG
