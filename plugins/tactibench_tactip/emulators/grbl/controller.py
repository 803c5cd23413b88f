"""GRBL's states, realtime bytes and alarms. Lines are carried out by ``program.Program``."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from tactibench_tactip.emulators.grbl.modes import SYSTEMS, Modes
from tactibench_tactip.emulators.grbl.planner import Block, Limits, Planner
from tactibench_tactip.emulators.grbl.program import Program
from tactibench_tactip.emulators.grbl.report import Report
from tactibench_tactip.emulators.grbl.settings import Settings
from tactibench_tactip.emulators.grbl.stage import Stage
from tactibench_tactip.emulators.grbl.words import OVERFLOW, GcodeError, plain
from tactibench_tactip.emulators.levels import Level
from tactibench_tactip.emulators.poses import Array

BUFFER = 128
"""Bytes that the receive buffer holds; what comes when it is full is lost."""
CRITICAL = (1, 2)
LOCKED = "[MSG:'$H'|'$X' to unlock]"
BANNER = "Grbl 1.1h ['$' for help]"


class Controller:
    """Bytes in by ``receive``, bytes out by ``take``; ``step`` lets time pass. Not thread-safe."""

    def __init__(self, stage: Stage, settings: Settings) -> None:
        self.stage, self.settings = stage, settings
        self.planner = Planner(stage.place, stage.speed, stage.go)
        self.systems: dict[str, Array] = {name: np.zeros(3) for name in SYSTEMS}
        self.probed, self.probe_hit, self.blind = np.zeros(3), False, 0
        self.homed = False
        self.t = 0.0
        self._out: list[str] = []
        self.mute, self.garble = 0, False
        self.state = "Idle"
        self._clear()

    def _clear(self) -> None:
        self.modes = Modes()
        self.report = Report()
        self._received: deque[int] = deque()
        self._line, self._too_long = "", False
        self._task: Iterator[None] | None = None
        self.halted = False
        self._held_until: float | None = None
        self._probe_end = math.inf
        self.cancelling = False
        self.planner.feed_share = self.planner.rapid_share = 1.0

    @property
    def limits(self) -> Limits:
        return Limits.of(self.settings)

    # Power and reset

    def power_up(self, t: float) -> None:
        """As when the port is opened: nothing is known of the position."""
        self.t = t
        self.planner.halt(t)
        self.stage.zero(t, np.zeros(3))
        self.homed = False
        self._out.clear()
        self._clear()
        self.state = "Alarm" if self.settings["$22"] else "Idle"
        self._greet()

    def _greet(self) -> None:
        self.modes.position = self.stage.place(self.t)
        self._out.append("\r\n")
        self._push(BANNER)
        if self.state == "Alarm":
            self._push(LOCKED)

    def reset(self) -> None:
        """0x18."""
        moving = self.state in {"Run", "Jog", "Home"}
        if moving or (self.state in {"Hold", "Door"} and len(self.planner)):
            self.lose(3)
        self.planner.halt(self.t)
        alarm = self.state == "Alarm"
        self._clear()
        self.state = "Alarm" if alarm else "Idle"
        self._greet()

    # Alarms

    def at(self, t: float) -> None:
        """It is t now; lines wait for the next ``step``."""
        self.t = max(self.t, t)
        self.planner.settle(self.t)

    def lose(self, number: int) -> None:
        """Stop at once; the position is lost."""
        self.stage.slip(self.t, min(self.settings.axes(120)))
        self.planner.halt(self.t)
        self.alarm(number)

    def alarm(self, number: int) -> None:
        """Print it and lock; after a critical one only a reset helps."""
        self.planner.clear()
        self._push(f"ALARM:{number}")
        self.state = "Alarm"
        self._held_until = None
        self._task = None
        if number in CRITICAL:
            self.halted = True
            self._push("[MSG:Reset to continue]")

    # Answers

    def push(self, text: str) -> None:
        """A message that nobody waits for."""
        self._push(text)

    def _push(self, text: str) -> None:
        self._out.append(text + "\r\n")

    def answer(self, error: int) -> None:
        """``ok`` or ``error:N``, unless a fault takes or damages it."""
        text = f"error:{error}" if error else "ok"
        if self.mute:
            self.mute -= 1
            return
        if self.garble:
            self.garble = False
            text = "\xff" + text[1:] + "\x00"
        self._push(text)

    def take(self) -> bytes:
        """What is to be sent."""
        out = "".join(self._out).encode("latin-1")
        self._out.clear()
        return out

    # Input

    def receive(self, data: bytes, t: float) -> None:
        """Realtime bytes act at once; all others wait in the buffer."""
        self.step(t)
        for byte in data:
            if byte in b"?!~\x18" or byte >= 0x80:
                self._realtime(byte)
            elif len(self._received) < BUFFER:
                self._received.append(byte)
        self.step(t)

    def _realtime(self, byte: int) -> None:
        if byte == 0x18:
            self.reset()
        elif self.halted:
            return
        elif byte == ord("?"):
            if self.state != "Home":
                self._push(self.report.status(self))
        elif byte == ord("!"):
            self.hold()
        elif byte == ord("~"):
            self._resume()
        elif byte == 0x84:
            self._pause("Door")
        elif byte == 0x85 and self.state == "Jog":
            self._cancel_jog()
        elif 0x90 <= byte <= 0x97:
            self._override(byte)

    def hold(self) -> None:
        """Feed hold: brake on the way; in a jog it cancels."""
        if self.state == "Jog":
            self._cancel_jog()
        elif self.state in {"Idle", "Run"}:
            self._pause("Hold")

    def _pause(self, state: str) -> None:
        if self.state in {"Idle", "Run", "Hold", "Jog"}:
            self._held_until = self.planner.brake(self.t, self.limits)
            self.state = state

    @property
    def held(self) -> bool:
        """Whether a hold has come to rest."""
        return self._held_until is not None and self.t >= self._held_until

    def _resume(self) -> None:
        if self.state in {"Hold", "Door"} and self.held:
            self._held_until = None
            self.state = "Idle"
            self.run()

    def _cancel_jog(self) -> None:
        self._held_until = self.planner.brake(self.t, self.limits)
        self.cancelling = True

    def _override(self, byte: int) -> None:
        planner = self.planner
        if byte <= 0x94:
            step = {0x90: 0.0, 0x91: 0.1, 0x92: -0.1, 0x93: 0.01, 0x94: -0.01}[byte]
            share = planner.feed_share + step if step else 1.0
            planner.feed_share = min(max(round(share, 2), 0.1), 2.0)
        else:
            planner.rapid_share = {0x95: 1.0, 0x96: 0.5, 0x97: 0.25}[byte]
        self.report.overrides_due()
        if self.state in {"Run", "Jog"} and not self.cancelling:
            planner.run(self.t, self.limits)

    # Motion

    def queue(self, target: Array, rate: float, state: str = "Run") -> None:
        """Plan a move to (3,) machine coordinates, rate mm/s. Nothing where it is there already."""
        steps = np.array(self.settings.axes(100))
        target = np.round(target * steps) / steps
        if np.array_equal(target, self.modes.position) and not len(self.planner):
            return
        if np.linalg.norm(target - self.modes.position) > 0:
            self.planner.add(Block(target, rate))
        self.modes.position = target
        self.run(state)

    def run(self, state: str = "Run") -> None:
        """Go on with what is planned."""
        if len(self.planner):
            self.planner.run(self.t, self.limits)
            self.state = state

    def within(self, target: Array) -> bool:
        """Whether a target keeps to the soft limits, where they are on."""
        travel = np.array(self.settings.axes(130))
        inside = bool(((target <= 1e-9) & (target >= -travel - 1e-9)).all())
        return inside or not self.settings["$20"]

    @property
    def moving(self) -> bool:
        return self.state in {"Run", "Jog", "Home"} or self._task is not None

    # Time

    def step(self, t: float) -> None:
        """Let time pass up to t, and carry out the lines that can be."""
        self.at(t)
        if self.cancelling and self.held:
            self.planner.clear()
            self.modes.position = self.stage.place(self.t)
            self.cancelling, self._held_until = False, None
        self._come_to_rest()
        while self._free() and (self._task is not None or self._next_line()):
            if next(self._task or iter(()), "done") is None:
                break
            self._task = None
        self._come_to_rest()

    def _come_to_rest(self) -> None:
        if self.state in {"Run", "Jog"} and not len(self.planner):
            self.state = "Idle"

    def _free(self) -> bool:
        return not self.halted and self.state not in {"Hold", "Door", "Sleep"}

    def _next_line(self) -> bool:
        """Begin with the next line of the buffer, if all of it is there."""
        while self._received:
            character = chr(self._received.popleft())
            if character not in "\r\n":
                self._line += character
                continue
            line, self._line = self._line, ""
            self._task = self._carried_out(line)
            return True
        return False

    def _carried_out(self, line: str) -> Iterator[None]:
        """One line to its answer; yields while it waits."""
        try:
            text = plain(line)
            if len(text) >= 80:
                raise GcodeError(OVERFLOW)
            yield from Program(self).line(text)
        except GcodeError as error:
            self.answer(error.number)
        else:
            if not self.halted:
                self.answer(0)

    # Probe

    def touching(self) -> bool:
        """Whether the probe's circuit is closed; a broken one never is."""
        return not self.blind and self.stage.touching(self.t)

    def listen(self) -> int | None:
        """Wait for the probe's circuit; None: it is broken."""
        self.probe_hit, self._probe_end = False, math.inf
        if self.blind:
            self.blind -= 1
            return None
        return self.stage.world.watch(Level("depth", 0.0, self._touched))

    def _touched(self, t: float) -> None:
        self.probed, self.probe_hit = self.stage.place(t), True
        self._probe_end = self.planner.brake(t, self.limits)

    def probe_stopped(self) -> bool:
        """Whether a probe has touched and come to rest."""
        return self.t >= self._probe_end

    def stop_listening(self, number: int | None) -> None:
        self._probe_end = math.inf
        if number is not None:
            self.stage.world.forget(number)

    # For reports

    @property
    def free_bytes(self) -> int:
        return BUFFER - len(self._received)

    def speed_mm_min(self) -> float:
        return math.floor(self.stage.speed(self.t) * 60 + 0.5)
