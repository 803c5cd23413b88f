"""A UR arm through ``ur_rtde``, which runs in a process of its own.

Moves are asynchronous and bounded: ``moveUntilContact`` has no limit of travel (and does nothing on
CB3), and a blocking ``moveL`` beside a watchdog kick loses the handshake that ends it.
"""

from __future__ import annotations

import re
import secrets
import socket
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from importlib.util import find_spec
from multiprocessing.connection import Connection, Listener
from typing import Any

from tactibench import UserError
from tactibench_tactip.geometry import angle_between, distance_between, from_ur, to_ur
from tactibench_tactip.robots import (
    ProtectiveStopError,
    Purpose,
    Robot,
    RobotError,
    RobotLostError,
    RobotState,
    missing_package,
)
from tactibench_tactip.settings import Pose6, Settings

NAMED_S = 0.5
"""Time within which a controller that ended the program says why: both come over other links."""
TCP_MM, TCP_DEG = 0.5, 0.5
"""Difference that the pendant's TCP may have from the configuration's: a TCP is taught as exactly
as this."""
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
MODES = {3: "power off", 5: "idle, brakes on"}
"""Robot modes that end a session (RTDE guide)."""
_VERSION = re.compile(r"(\d+)\.(\d+)")
STARTED_S = 10.0
END_S = 3.0
ORDER_S = 8.0
"""Longest wait for the answer of the process to an order."""
TICK_S = 0.004
"""Time for which facts are not asked for again: half a turn of the process."""
STALE_S, MOST_STALE_S = 0.5, 1.0
"""Least and greatest time for which the controller may send no new state. In between it is a period
of the watchdog. The greatest is less than the time after which a move is given up."""


class UrLink:
    """A connection that starts the process and gives it orders, one after the other.

    The arm has neither watchdog nor TCP until it is asked to ``prepare``.

    Args:
        host: Address of the controller.
        moves: Whether the arm shall move; otherwise it is read only.
        tcp: TCP to set, m and a rotation vector, rad.
        watchdog_hz: Rate of the watchdog.
        seconds: Time within which the arm must answer.

    Attributes:
        tcp_before: The controller's own TCP, m and a rotation vector, rad; [] where it is not told.
        load: Mass, kg, and centre of gravity, m, of the payload; [] where it is not told.

    Raises:
        RobotError: The process does not start, or the arm does not answer in time.
        UserError: The package ur_rtde is missing, or the arm refuses the connection.
    """

    def __init__(
        self, host: str, moves: bool, tcp: list[float], watchdog_hz: float, seconds: float
    ) -> None:
        if find_spec("rtde_control") is None:
            raise missing_package(
                "ur_rtde", "ur", " (it has no wheel for Python 3.13: take Python 3.11 or 3.12)"
            )
        self._host = host
        self._lock = threading.Lock()
        self._facts: dict[str, Any] = {"time": -1.0}
        self._stale_s = min(MOST_STALE_S, max(STALE_S, 1.0 / watchdog_hz))
        self._asked_at = self._changed_at = 0.0
        self._link = self._start()
        try:
            self._link.send((host, moves, tcp, watchdog_hz))
            if not self._link.poll(seconds):
                raise RobotError(
                    f"the UR at {host} did not answer within {seconds:g} s; check that it is "
                    "switched on and that nothing else controls it."
                )
            reply = self._link.recv()
        except (EOFError, OSError):
            reply = {"failed": "the process that talks to it ended"}
        except BaseException:
            self.close()
            raise
        if "failed" in reply:
            self.close()
            advice = "look at the pendant and the network cable, and end what else controls the arm"
            if "in use" in reply["failed"].lower():
                advice = "a fieldbus uses its registers: switch that off on the pendant"
            raise UserError(
                f"the UR at {host} refuses the connection ({reply['failed']}); {advice}."
            )
        self.tcp_before: list[float] = reply["tcp"]
        self.load: list[float] = reply["load"]

    def ask(self, what: str, *given: Any) -> Any:
        """Have the process call a method of ``Arm``, and return what that returns.

        Args:
            what: Name of the method.
            given: Its arguments.

        Raises:
            RobotLostError: The process ended, or does not answer in time.
        """
        with self._lock:
            self._asked_at = 0.0
            try:
                self._link.send((what, given))
                if self._link.poll(ORDER_S):
                    return self._link.recv()
                self._link.close()  # a late answer must not be taken for that of another order
            except (EOFError, OSError):
                pass
        raise self._lost()

    def facts(self) -> dict[str, Any]:
        """Return the present facts, which are newer than the last order.

        Raises:
            RobotLostError: The controller sends no new state, or the connection to it is lost.
        """
        if time.monotonic() - self._asked_at > TICK_S:
            before = self._facts["time"]
            self._facts = self.ask("facts")
            self._asked_at = time.monotonic()
            if self._facts["time"] != before:
                self._changed_at = self._asked_at
        if not self._facts["linked"] or self._asked_at - self._changed_at > self._stale_s:
            raise self._lost()
        return self._facts

    def _lost(self) -> RobotLostError:
        return RobotLostError(
            f"the controller at {self._host} sends nothing any more ({self._last_word()}); check "
            "the network cable. Its watchdog stops the arm."
        )

    def close(self) -> None:
        """End the process, which stops the arm.

        A process that hangs is killed; the controller's watchdog then stops the arm.
        """
        self._link.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(END_S)
        self._stderr.close()

    def _start(self) -> Connection:
        key = secrets.token_hex(16).encode()
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115 - as long as the process lives
        with Listener(("127.0.0.1", 0), authkey=key) as listener:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tactibench_tactip.ur_worker", str(listener.address[1])],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._stderr,
                # Ctrl-C is for this process, which stops the arm in order. A session of its own
                # would do, too, but the kernel shares the processor between sessions, and starves
                # it under load.
                process_group=0,
            )
            assert self._process.stdin is not None  # noqa: S101
            self._process.stdin.write(key + b"\n")
            self._process.stdin.close()
            accepted: list[Connection] = []
            waiter = threading.Thread(
                target=lambda: accepted.append(listener.accept()), daemon=True
            )
            waiter.start()
            waiter.join(STARTED_S)
        if not accepted:
            self._process.kill()
            raise RobotError("the process that talks to the UR did not start.")
        return accepted[0]

    def _last_word(self) -> str:
        """Return the last line that the process of the arm wrote to stderr."""
        if self._stderr.closed:
            return "it was closed"
        self._stderr.seek(0)
        lines = self._stderr.read().decode("utf-8", "replace").splitlines()
        return next((line.strip() for line in reversed(lines) if line.strip()), "no word")


class UrRobot(Robot):
    """A UR arm; the base frame is the controller's, the TCP that of the configuration."""

    turns = True

    def __init__(self, settings: Settings) -> None:
        self._settings = settings.robot
        self._tcp = settings.frames.tcp_pose
        self._open_link: UrLink | None = None
        self._dashboard: Dashboard | None = None
        self._closed = self._reads = False

    def connect(self, purpose: Purpose = "move") -> None:
        """Connect to the arm.

        Raises:
            UserError: The arm is not there, is not ready, runs a program, or has another TCP than
                the configuration.
            RobotError: The arm does not answer in time, or cannot be prepared.
        """
        settings = self._settings
        self._reads = purpose == "look"
        if self._reads:
            self.proviso = ", if the pendant's TCP is frames.tcp_pose"
        self._dashboard = Dashboard(settings.address)
        self._dashboard.check_ready()
        program = self._dashboard.program
        if not (self._reads or program.startswith("STOPPED")):
            raise UserError(
                f"the UR says {program!r} of its program, and moving the arm would end that; end "
                "it on the pendant, then run the same command."
            )
        rate, seconds = settings.watchdog_hz, settings.connect_s
        self._open_link = UrLink(settings.address, not self._reads, to_ur(self._tcp), rate, seconds)
        if self._closed:  # the caller no longer waits
            self._open_link.close()
        elif not self._reads:
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

    def moving(self) -> bool:
        """Return whether the controller reports a move."""
        return bool(self._link.facts()["moving"])

    def pose(self) -> Pose6:
        """Return the pose of the tool; where it is only read, by the pendant's TCP."""
        return from_ur(self._link.facts()["pose"])

    def stop(self) -> None:
        """Brake the arm."""
        self._check(self._link.ask("stop"))

    def state(self) -> RobotState:
        """Return the state, from the safety status, the mode and the program."""
        end = time.monotonic() + NAMED_S
        while True:
            facts = self._link.facts()
            state = safety_state(facts["bits"], facts["mode"])
            runs = self._reads or facts["program"] or not state.normal
            if runs or time.monotonic() > end:
                break
            time.sleep(TICK_S)
        if state.normal and facts["program"] == self._reads:
            wrong = "its control program ended (watchdog, pendant or another client)"
            if self._reads:
                wrong = f"a program runs, {self.describe()['program']}, which a move would end"
            state = RobotState(normal=False, description=f"the UR says: {wrong}")
        fx, fy, fz = facts["force"]
        share = facts["slider"]
        return replace(state, force_n=(fx, fy, fz), time_s=facts["time"], speed_share=share)

    def close(self) -> None:
        """Let go of the arm, which stops."""
        self._closed = True
        if self._open_link is not None:
            self._open_link.close()
        if self._dashboard is not None:
            self._dashboard.close()

    def describe(self) -> dict[str, str]:
        """Return the version, and what the pendant says: program, speed slider, payload."""
        facts = {"driver": "ur"}
        if self._dashboard is not None:
            facts |= {"polyscope": self._dashboard.version, "program": self._dashboard.program}
        if self._open_link is not None:
            facts["speed_slider"] = f"{100 * self._open_link.facts()['slider']:.0f} %"
            facts["payload"] = "not told"
            if self._open_link.load:
                mass, *centre = self._open_link.load
                place = ", ".join(f"{1e3 * value:.0f}" for value in centre)
                facts["payload"] = f"{mass:.2f} kg, its centre of gravity at {place} mm"
        return facts

    @property
    def _link(self) -> UrLink:
        assert self._open_link is not None, "connected"  # noqa: S101
        return self._open_link

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
        self.version = self.program = ""
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
        self.version, self.program = self.ask("PolyscopeVersion"), self.ask("programState")
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


def safety_state(bits: int, mode: int) -> RobotState:
    """Return whether the arm may be moved, and everything that keeps it from moving.

    It counts as stopped where a protective stop is the only reason.

    Args:
        bits: Safety status bits.
        mode: Robot mode.
    """
    stops = [bit for bit in STOP_BITS if bits >> bit & 1]
    reasons = [STOP_BITS[bit] for bit in stops]
    if mode != RUNNING:
        reasons.append(MODES.get(mode, f"robot mode {mode}"))
    reduced = bool(bits >> REDUCED & 1)
    return RobotState(
        normal=not reasons and (reduced or bool(bits >> NORMAL & 1)),
        description=f"the UR says: {', '.join(reasons) or ('reduced' if reduced else 'normal')}",
        stopped=stops == [PROTECTIVE],
    )
