"""The control script of ur_rtde as it behaves: commands in registers, ready and done in others.

Imitated from the main loop of the script that ur_rtde 1.6.5 uploads. What it can do and what is
not emulated here (force mode, servoing, paths, freedrive, jogging) is answered as done, with a
message: a caller sees no motion.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

from tactibench_tactip.emulators.ur import commands
from tactibench_tactip.emulators.ur.contact import Contact

if TYPE_CHECKING:
    from tactibench_tactip.emulators.ur.controller import Controller

READY, DONE = 1, 2
CYCLE_S = 0.002
"""Host seconds of one turn of the main loop: the handshake is between hosts, whatever the scale."""
REALTIME = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)})
STOP_SCRIPT = 255
RUNNING_BIT, COUNTS = 1 << 15, 128
_OFFSET = r"reg_offset_{}\s*=\s*(?:#[^\n]*\n\s*)?(\d+)"
"""ur_rtde writes the number behind the comment that follows, at the start of the next line."""


class Script:
    """offset: of the registers, 0 or 24."""

    def __init__(self, controller: Controller, offset: int, float_offset: int) -> None:
        self.controller, self.offset, self.float_offset = controller, offset, float_offset
        self._executing = False
        self._waiting: Callable[[float], bool] | None = None
        self._after: Callable[[float], None] | None = None
        self._turn_at = 0.0
        self.t = 0.0
        self._watchdog_s, self._fed_at = 0.0, 0.0
        self._writes = self._operation = 0
        self.async_running = False
        self.pushing: tuple[float, ...] = ()
        self.contact: Contact | None = None

    @classmethod
    def of(cls, controller: Controller, text: str) -> Script | None:
        """None for a text that is not this script."""
        whole = re.search(_OFFSET.format("int"), text)
        real = re.search(_OFFSET.format("float"), text)
        if whole is None or real is None:
            return None
        return cls(controller, int(whole[1]), int(real[1]))

    # Registers

    def whole(self, number: int) -> int:
        return int(self.controller.inputs.get(f"input_int_register_{number + self.offset}", 0))

    def real(self, number: int) -> float:
        name = f"input_double_register_{number + self.float_offset}"
        return float(self.controller.inputs.get(name, 0.0))

    def reals(self, first: int, count: int = 6) -> list[float]:
        return [self.real(first + k) for k in range(count)]

    def answer(self, value: int) -> None:
        """Output integer register 1."""
        self.controller.out_int[1 + self.offset] = value

    def answers(self, values: list[float]) -> None:
        """Output double registers from 0 on."""
        start = self.float_offset
        self.controller.out_double[start : start + len(values)] = values

    def _signal(self, value: int) -> None:
        self.controller.out_int[self.offset] = value

    # Main loop

    def begin(self, host: float) -> None:
        """The script was started."""
        self._fed_at = host
        self._signal(READY)
        self.progress(-1)

    def written(self, names: tuple[str, ...], host: float, t: float) -> None:
        """Input registers were written: feeds the watchdog, and the loop looks."""
        if f"input_int_register_{self.offset}" in names:
            self._fed_at = host
        self.step(host, t)

    def step(self, host: float, t: float) -> None:
        """Turns of the main loop that are due."""
        self.t = t
        if self._watchdog_s and host - self._fed_at > self._watchdog_s:
            self.controller.messages.append("watchdog: the client was too slow, the program stops")
            self.controller.end_program(t)
            return
        if self.async_running and not self.controller.arm.moving(t):
            self.finish()
        if self._waiting is not None:
            if not self._waiting(t):
                return
            self._waiting = None
            if self._after is not None:
                self._after(t)
                self._after = None
            self._signal(DONE)
            self._executing, self._turn_at = True, host + CYCLE_S
        if host >= self._turn_at:
            self._turn(self.whole(0), t)

    def _turn(self, command: int, t: float) -> None:
        if command == STOP_SCRIPT:
            self.controller.end_program(t)
        elif command in REALTIME:
            commands.carry_out(self, command)
            self._signal(READY)
        elif command == 0:
            self._executing = False
            self._signal(READY)
        elif not self._executing:
            commands.carry_out(self, command)
            if self._waiting is None:
                self._signal(DONE)
            self._executing = True

    def wait(
        self, until: Callable[[float], bool], after: Callable[[float], None] | None = None
    ) -> None:
        """The command that is carried out takes until then; the loop stands still meanwhile."""
        self._waiting, self._after = until, after

    def watchdog(self, hertz: float) -> None:
        self._watchdog_s = 1 / hertz if hertz > 0 else 0.0

    def release(self) -> None:
        """The program ends."""
        if self.contact is not None:
            self.contact.end()
            self.contact = None

    # Asynchronous operations: bits 0-14 progress, 15 running, 16-22 writes, 24-30 operation

    def start(self) -> None:
        """An asynchronous operation begins."""
        self.async_running = True
        self.progress(0)

    def finish(self) -> None:
        """It has ended, or was stopped."""
        if self.async_running:
            self.async_running = False
            self.progress(-1)

    def progress(self, value: int) -> None:
        """0: an operation began; negative: it ended."""
        self._writes = (self._writes + 1) % COUNTS
        if value == 0:
            self._operation = (self._operation + 1) % COUNTS
        word = self._writes << 16 | self._operation << 24
        if value >= 0:
            word |= min(value, RUNNING_BIT - 1) | RUNNING_BIT
        self.controller.out_int[2 + self.offset] = word
