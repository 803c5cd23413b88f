"""The process that holds a UR: ``ur_rtde`` in a loop of 125 Hz.

``ur_rtde`` keeps Python's lock while it waits, in its constructors without end and in a move for up
to 300 s; in a process of its own it can block nothing but itself. This process carries out the
orders that come over a local connection, and kicks the watchdog at every turn. When the connection
ends, for whatever reason, it stops the arm and ends. It imports little, so that it starts at once.
Poses are here as the controller has them, m and a rotation vector, rad.

    python -m tactibench_tactip.ur_worker PORT < key
"""

from __future__ import annotations

import sys
import time
from multiprocessing.connection import Client, Connection
from typing import Any

VARIABLES = (
    "timestamp",
    "actual_TCP_pose",
    "actual_TCP_force",
    "robot_mode",
    "safety_mode",
    "safety_status_bits",
    "runtime_state",
    "target_speed_fraction",
)
"""Variables to receive: a short list at 125 Hz, because all variables at 500 Hz take a core."""
LOAD = ("payload", "payload_cog")
"""Variables that controllers before 3.11 and 5.5 do not have."""
STOPPED = 1
"""Runtime state in which no program runs or is paused."""
HZ = 125.0
STOP_M_S2 = 2.0
"""Deceleration of a stop."""


class Arm:
    """The two interfaces of ur_rtde, which return False instead of raising an exception.

    Methods that return a text return what went wrong, or "".

    Args:
        host: Address of the controller.
        moves: Whether the arm shall move; otherwise it is read only, and what runs there goes on.
        tcp: TCP to set, m and a rotation vector, rad.
        watchdog_hz: Rate of the watchdog.

    Attributes:
        tcp_before: The controller's TCP until ``prepare`` sets another one; [] where it is only
            read, because the controller tells it to a program of its own alone.
        load: Mass, kg, and centre of gravity, m, of the payload; [] where it is not told.

    Raises:
        RuntimeError: A program runs there, which connecting would end.
    """

    def __init__(self, host: str, moves: bool, tcp: list[float], watchdog_hz: float) -> None:
        from rtde_control import RTDEControlInterface
        from rtde_receive import RTDEReceiveInterface

        self._control: Any = None
        self._tcp, self._watchdog_hz = tcp, watchdog_hz
        self.tcp_before: list[float] = []
        self.load: list[float] = []
        try:
            self._receive = RTDEReceiveInterface(host, HZ, [*VARIABLES, *LOAD])
            self.load = [self._receive.getPayload(), *self._receive.getPayloadCog()]
        except RuntimeError:
            self._receive = RTDEReceiveInterface(host, HZ, list(VARIABLES))
        if moves:
            if self.facts()["program"]:
                raise RuntimeError("a program runs there")
            self._control = RTDEControlInterface(host)
            self.tcp_before = list(self._control.getTCPOffset())

    def prepare(self) -> str:
        """Set watchdog and TCP."""
        if not self._control.setWatchdog(self._watchdog_hz):
            return "the watchdog could not be set"
        return "" if self._control.setTcp(self._tcp) else "the TCP could not be set"

    def start(self, pose: list[float], speed: float, acceleration: float) -> str:
        """Begin a straight move.

        Args:
            pose: m and a rotation vector, rad.
            speed: Top speed, m/s.
            acceleration: Acceleration, m/s2.
        """
        within = self._control.isPoseWithinSafetyLimits(pose)
        if not self._control.isProgramRunning():  # a running program would have answered
            return "its control program has ended"
        if not within:
            return "its safety limits exclude the next pose; look at its planes and at [frames]"
        if not self._control.moveL(pose, speed, acceleration, True):
            return "it did not begin a move"
        return ""

    def stop(self) -> str:
        """Brake the arm."""
        # A program that has ended gives no answer, and the arm stands.
        if self._control and self._control.isProgramRunning():
            self._control.stopL(STOP_M_S2, True)
        return ""

    def kick(self) -> None:
        """Keep the watchdog quiet."""
        if self._control:
            self._control.kickWatchdog()

    def facts(self) -> dict[str, Any]:
        """Return the present state of the controller; its program is ours, unless it is read."""
        receive, control = self._receive, self._control
        facts = {
            "time": receive.getTimestamp(),
            "pose": receive.getActualTCPPose(),
            "force": list(receive.getActualTCPForce())[:3],
            "bits": int(receive.getSafetyStatusBits()),
            "mode": int(receive.getRobotMode()),
            "slider": receive.getTargetSpeedFraction(),
            "linked": bool(receive.isConnected()),
            "program": receive.getRuntimeState() != STOPPED,
            "moving": False,
        }
        if control:
            progress = control.getAsyncOperationProgressEx()
            facts["linked"] = bool(facts["linked"] and control.isConnected())
            facts["program"] = bool(control.isProgramRunning())
            # The last word of a program that has ended may be that it moves.
            facts["moving"] = facts["program"] and bool(progress.isAsyncOperationRunning())
        return facts

    def close(self) -> None:
        """End the control program and disconnect."""
        if self._control:
            self._control.stopScript()
            self._control.disconnect()
        self._receive.disconnect()


def serve(link: Connection) -> None:
    """Carry out the orders of the other side until the connection ends."""
    settings = link.recv()
    try:
        arm = Arm(*settings)
    except Exception as error:  # noqa: BLE001 - sent to the other side
        link.send({"failed": " ".join(str(error).split())})
        return
    link.send({"tcp": arm.tcp_before, "load": arm.load})
    due = time.monotonic()
    try:
        while True:
            while link.poll(max(0.0, due - time.monotonic())):
                name, given = link.recv()
                link.send(getattr(arm, name)(*given))
            arm.kick()
            due = max(due + 1.0 / HZ, time.monotonic())
    except (EOFError, OSError):  # the other side is gone
        pass
    finally:
        arm.stop()
        arm.close()


def main() -> None:
    """Connect to the port of the command line and serve."""
    key = sys.stdin.buffer.readline().strip()
    with Client(("127.0.0.1", int(sys.argv[1])), authkey=key) as link:
        serve(link)


if __name__ == "__main__":
    main()
