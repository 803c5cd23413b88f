"""The state of a UR controller: arm, control program, safety, registers.

The program behaves as the script that ur_rtde 1.6.5 uploads: an input register holds a command, an
output register says ready or done. The commands that the driver uses are carried out; every other
command is answered as done, with a message.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from tactibench_tactip.emulators.motion import (
    METRE,
    Array,
    Move,
    Pose6,
    from_ur,
    inverse,
    matrix,
    to_ur,
)
from tactibench_tactip.emulators.watch import Watch
from tactibench_tactip.emulators.world import World

STOPPED, PLAYING = 1, 2
"""Values of ``runtime_state``."""
POWER_OFF, RUNNING = 3, 7
"""Values of ``robot_mode``."""
NORMAL_BIT, PROTECTIVE_BITS, EMERGENCY_BITS = 1, 1 << 2 | 1 << 10, 1 << 6 | 1 << 7 | 1 << 10
SAFETY = {
    "NORMAL": (1, NORMAL_BIT),
    "PROTECTIVE_STOP": (3, PROTECTIVE_BITS),
    "ROBOT_EMERGENCY_STOP": (7, EMERGENCY_BITS),
}
"""Name on the dashboard -> safety_mode, safety_status_bits."""
REACH_MM = 850.0
"""Reach of a UR5e, to the middle of its flange."""
HALT_MM_S2 = 5000.0
"""Deceleration of a stop that the controller makes itself (assumed)."""
REBOUND_N = 1.0
"""Growth that stops the arm again where the force is already too great at an unlock (assumed)."""
READY, DONE = 1, 2
MOVE_L, SET_TCP, STOP_L, WATCHDOG, SAFE_POSE, STOP_SCRIPT = 3, 29, 33, 35, 36, 255
GET_TCP = 40
RUNNING_BIT, COUNTS = 1 << 15, 128
"""Word of an asynchronous operation: bit 15 is set while it runs, bits 16-22 count the writes and
bits 24-30 the operations, both modulo COUNTS."""


class Controller:
    """The state that the servers of a UR share.

    All methods are called under the world's lock; every ``t`` is a time of the world, s.

    Args:
        world: The world in which the arm moves.
        tool: True place of the world's tool point on the flange, mm and deg. The controller
            believes the same until a client sets another TCP.
        remote: Whether the pendant is in remote control; otherwise it is in local mode.
        stop_force_n: Force at which it stops protectively.
        unlock_delay_s: Seconds of the world after a protective stop in which an unlock is refused.
        host: Clock of the host, s, by which the watchdog goes.
    """

    def __init__(
        self,
        world: World,
        tool: Pose6,
        *,
        remote: bool = True,
        stop_force_n: float = 50.0,
        unlock_delay_s: float = 5.0,
        host: Callable[[], float] = time.monotonic,
    ) -> None:
        self.world, self.remote = world, remote
        self.safety, self.robot_mode, self.runtime_state = "NORMAL", RUNNING, STOPPED
        self.refusals = 0
        self.t = 0.0
        self.inputs: dict[str, float] = {}
        self.out_int, self.out_double = [0, 0, 0], [0.0] * 6
        self.slider = 1.0
        self._stop_force, self._unlock_delay, self._host = stop_force_n, unlock_delay_s, host
        self._base = matrix(world.rig.work_frame)
        self._tool = matrix(tool)
        self._tcp = matrix(tool)
        self._stopped_at = -math.inf
        self._guard: int | None = None
        self._executing = self._operating = False
        self._fed_at = self._watchdog_s = 0.0
        self._writes = self._operation = 0
        self._watch_force()

    # State that RTDE shows

    @property
    def safety_mode(self) -> int:
        """Number of the safety mode."""
        return SAFETY[self.safety][0]

    @property
    def safety_bits(self) -> int:
        """The safety status bits."""
        return SAFETY[self.safety][1]

    @property
    def status_bits(self) -> int:
        """Bit 0: power on; bit 1: a program runs."""
        return (self.robot_mode == RUNNING) | (self.runtime_state == PLAYING) << 1

    def pose(self) -> Array:
        """Return the pose (6,) of the TCP in the base frame, m and a rotation vector, rad."""
        return to_ur(self._base @ self.world.pose_at(self.t) @ inverse(self._tool) @ self._tcp)

    def force(self) -> Array:
        """Return the force (6,) on the TCP in the base frame, N, away from the sensor.

        The torques are 0.
        """
        away = (self._base @ matrix(self.world.rig.sensor_frame))[:3, 2]
        return np.concatenate([away * self.world.force(self.t), np.zeros(3)])

    # Program

    def load(self, text: str, t: float) -> None:
        """Run a script that a client sent, and end the program that runs.

        A script is refused in local mode and where the safety status is not normal.
        """
        if not self.remote or self.safety != "NORMAL":
            return
        self.end_program(t)
        if "reg_offset_int" not in text:
            return  # a script that is not emulated ends at once
        self.runtime_state = PLAYING
        self._executing, self._watchdog_s, self._fed_at = False, 0.0, self._host()
        self.out_int[0] = READY
        self._tell_operation(running=False)

    def end_program(self, t: float) -> None:
        """End the program; the arm stops."""
        if self.runtime_state == PLAYING:
            self.world.brake(t, HALT_MM_S2)
        self.runtime_state = STOPPED

    def written(self, names: Sequence[str], t: float) -> None:
        """Note that input registers were written: feed the watchdog, and let the program go on."""
        if "input_int_register_0" in names:
            self._fed_at = self._host()
        self.step(t)

    def step(self, t: float) -> None:
        """Let the program go on at time ``t``."""
        self.t = t
        if self.runtime_state != PLAYING:
            return
        if self._watchdog_s and self._host() - self._fed_at > self._watchdog_s:
            self.end_program(t)
            return
        if self._operating and t >= self.world.still_s:
            self._tell_operation(running=False)
        self._turn(int(self.inputs.get("input_int_register_0", 0)))

    def _turn(self, command: int) -> None:
        """Run one turn of the script's loop."""
        if command == STOP_SCRIPT:
            self.end_program(self.t)
        elif command == 0:
            self._executing = False
            self.out_int[0] = READY
        elif not self._executing:
            self._carry_out(command)
            self._executing = True
            self.out_int[0] = DONE

    def _carry_out(self, command: int) -> None:
        if command == MOVE_L:
            self._move(self._reals(0, 6), self._reals(6, 2))
            self._tell_operation(running=True)
        elif command == STOP_L:
            self.world.brake(self.t, self._reals(0, 1)[0] * METRE)
            self._tell_operation(running=True)
        elif command == SET_TCP:
            self._tcp = from_ur(self._reals(0, 6))
        elif command == GET_TCP:
            self.out_double = [float(value) for value in to_ur(self._tcp)]
        elif command == WATCHDOG:
            hertz = self._reals(0, 1)[0]
            self._watchdog_s = 1 / hertz if hertz > 0 else 0.0
        elif command == SAFE_POSE:
            flange = from_ur(self._reals(0, 6)) @ inverse(self._tcp)
            self.out_int[1] = int(float(np.linalg.norm(flange[:3, 3])) <= REACH_MM)

    def _reals(self, first: int, count: int) -> list[float]:
        """Return ``count`` double input registers from number ``first`` on."""
        names = [f"input_double_register_{first + k}" for k in range(count)]
        return [float(self.inputs.get(name, 0.0)) for name in names]

    def _move(self, pose: Sequence[float], limits: Sequence[float]) -> None:
        """Move straight to a pose of the TCP; a present move is braked first.

        Args:
            pose: (6,) m and a rotation vector, rad.
            limits: Speed, m/s, and acceleration, m/s2.
        """
        speed, acceleration = limits[0] * METRE, limits[1] * METRE
        moves = []
        start, now = self.world.pose_at(self.t), self.world.move_at(self.t)
        begin = self.t
        if now is not None:
            moves.append(now.braked(self.t, acceleration))
            begin = moves[0].end_s
            start = moves[0].pose(begin)
        end = inverse(self._base) @ from_ur(pose) @ inverse(self._tcp) @ self._tool
        self.world.follow(self.t, *moves, Move.travel(begin, start, end, speed, acceleration))

    def _tell_operation(self, *, running: bool) -> None:
        """Write the word of the asynchronous operation: a new one runs, or the last one ended."""
        self._writes = (self._writes + 1) % COUNTS
        self._operation = (self._operation + running) % COUNTS
        word = self._writes << 16 | self._operation << 24
        self.out_int[2] = word | (RUNNING_BIT if running else 0)
        self._operating = running

    # Safety

    def protective_stop(self, t: float) -> None:
        """Brake and end the program; the stop lasts until an unlock."""
        if self.safety == "NORMAL":
            self.end_program(t)
            self.safety, self._stopped_at = "PROTECTIVE_STOP", t

    def emergency_stop(self, t: float) -> None:
        """Stop as the red button does; only ``repair`` ends this stop."""
        self.end_program(t)
        self.safety, self.robot_mode = "ROBOT_EMERGENCY_STOP", POWER_OFF

    def refuse_unlocks(self, count: float) -> None:
        """Refuse ``count`` more unlocks, whatever the delay."""
        self.refusals += int(count)

    def repair(self) -> None:
        """Release the buttons and switch the arm on again."""
        self.safety, self.robot_mode = "NORMAL", RUNNING
        self._watch_force()

    def unlock(self, t: float) -> bool:
        """Leave a protective stop; return False where that is refused."""
        if self.safety == "PROTECTIVE_STOP" and t - self._stopped_at < self._unlock_delay:
            return False
        if self.refusals > 0:
            self.refusals -= 1
            return False
        if self.safety == "PROTECTIVE_STOP":
            self.safety = "NORMAL"
            self._watch_force()
        return True

    def _watch_force(self) -> None:
        if self._guard is not None:
            self.world.forget(self._guard)
        beyond = self.world.force(self.world.advance()) + REBOUND_N
        level = max(self._stop_force, beyond)
        self._guard = self.world.watch(Watch("force", level, self._on_force))

    def _on_force(self, t: float) -> None:
        self._guard = None
        self.protective_stop(t)
