"""The controller's state: safety, program, registers."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable

from tactibench_tactip.emulators.levels import Level
from tactibench_tactip.emulators.ur.arm import Arm
from tactibench_tactip.emulators.ur.script import Script
from tactibench_tactip.emulators.world import World

STOPPED, PLAYING = 1, 2
RUNNING, POWER_OFF = 7, 3
REGISTERS = 48
CB3_MAJOR = 3
REBOUND_N = 1.0
"""What too great a force may grow after an unlock before it stops again (assumed)."""
NORMAL_BIT, PROTECTIVE_BITS, EMERGENCY_BITS = 1, 1 << 2 | 1 << 10, 1 << 6 | 1 << 7 | 1 << 10
SAFETY = {
    "NORMAL": (1, NORMAL_BIT),
    "PROTECTIVE_STOP": (3, PROTECTIVE_BITS),
    "ROBOT_EMERGENCY_STOP": (7, EMERGENCY_BITS),
}
"""Name on the dashboard -> safety_mode, safety_status_bits."""


class Controller:
    """All that the three servers share. Under the world's lock."""

    def __init__(
        self,
        world: World,
        arm: Arm,
        version: tuple[int, int, int, int],
        remote: bool,
        stop_force_n: float,
        contact_force_n: float,
        unlock_delay_s: float,
        host: Callable[[], float] = time.monotonic,
    ) -> None:
        """host: the time between hosts, s, by which handshakes and the watchdog go."""
        self.world, self.arm, self._host = world, arm, host
        self.version, self.remote = version, remote
        self.stop_force_n, self.contact_force_n = stop_force_n, contact_force_n
        self.unlock_delay_s = unlock_delay_s
        self.safety, self.robot_mode, self.runtime_state = "NORMAL", RUNNING, STOPPED
        self.refusals = 0
        self.out_int, self.out_double = [0] * REGISTERS, [0.0] * REGISTERS
        self.inputs: dict[str, float] = {}
        self.messages: deque[str] = deque(maxlen=256)
        self.script: Script | None = None
        self.payload = 0.0
        self.t = 0.0
        self._stopped_at = -math.inf
        self._guard: int | None = None
        self._watch_force()

    @property
    def is_cb3(self) -> bool:
        return self.version[0] == CB3_MAJOR

    # What RTDE shows

    @property
    def safety_mode(self) -> int:
        return SAFETY[self.safety][0]

    @property
    def safety_bits(self) -> int:
        return SAFETY[self.safety][1]

    @property
    def status_bits(self) -> int:
        """b0 power on, b1 program running."""
        return (self.robot_mode == RUNNING) | (self.runtime_state == PLAYING) << 1

    # Program

    def load(self, text: str, t: float) -> None:
        """Run a script that came over the wire; what runs is ended."""
        if not self.remote:
            self.messages.append("a script was refused: the robot is in local control")
            return
        if self.safety != "NORMAL":
            self.messages.append(f"a script was refused: safety status {self.safety}")
            return
        self.end_program(t)
        script = Script.of(self, text)
        if script is None:
            self.messages.append(f"a script of {len(text)} bytes is not emulated: it ends at once")
            return
        self.runtime_state, self.script = PLAYING, script
        script.begin(self._host())

    def end_program(self, t: float) -> None:
        """The program ends and the arm stops."""
        if self.runtime_state == PLAYING:
            self.arm.halt(t)
        if self.script is not None:
            self.script.release()
        self.runtime_state, self.script = STOPPED, None

    def written(self, names: tuple[str, ...], t: float) -> None:
        """Input registers were written."""
        if self.script is not None:
            self.script.written(names, self._host(), t)

    def step(self, t: float) -> None:
        """It is t now; let the program go on."""
        self.t = t
        if self.script is not None:
            self.script.step(self._host(), t)

    # Safety

    def protective_stop(self, t: float) -> None:
        """Brake, end the program, wait for somebody to unlock."""
        if self.safety == "NORMAL":
            self.end_program(t)
            self.arm.halt(t)
            self.safety, self._stopped_at = "PROTECTIVE_STOP", t

    def emergency_stop(self, t: float) -> None:
        """As by the red button; it stays."""
        self.end_program(t)
        self.arm.halt(t)
        self.safety, self.robot_mode = "ROBOT_EMERGENCY_STOP", POWER_OFF

    def unlock(self, t: float) -> bool:
        """Leave a protective stop; False: refused, or there is none."""
        if self.safety == "PROTECTIVE_STOP" and t - self._stopped_at < self.unlock_delay_s:
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
        level = Level("force", max(self.stop_force_n, beyond), self._too_hard)
        self._guard = self.world.watch(level)

    def _too_hard(self, t: float) -> None:
        self._guard = None
        self.messages.append(f"protective stop: the force passed {self.stop_force_n:g} N")
        self.protective_stop(t)
