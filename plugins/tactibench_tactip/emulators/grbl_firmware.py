"""The firmware GRBL 1.1h of a three-axis stage, as far as the driver uses it.

It answers jogs, probing, homing, status reports, settings and alarms word for word as the firmware
does. Other G-code is answered with error 20, other ``$`` lines with error 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from tactibench import UserError
from tactibench_tactip.emulators.gcode import (
    HOMING_OFF,
    JOG_TRAVEL,
    NO_G_CODE,
    NOT_IDLE,
    STATEMENT,
    UNSUPPORTED,
    GcodeError,
    format_axes,
    parse_words,
)
from tactibench_tactip.emulators.motion import Array, Move, inverse, matrix
from tactibench_tactip.emulators.watch import Watch
from tactibench_tactip.emulators.world import World

SETTINGS = {
    "$13": 0.0,
    **dict.fromkeys(("$20", "$21", "$22"), 1.0),
    "$25": 500.0,
    "$27": 1.0,
    **dict.fromkeys(("$100", "$101", "$102"), 250.0),
    **dict.fromkeys(("$110", "$111", "$112"), 3000.0),
    **dict.fromkeys(("$120", "$121", "$122"), 500.0),
    **dict.fromkeys(("$130", "$131", "$132"), 200.0),
}
"""Settings of a small stage (mm, s, mm/min): limits on, 50 mm/s, 500 mm/s2, travel 200 mm."""
CRITICAL_ALARMS = (1, 2)
"""Alarms after which only a reset is answered."""
OFFSET_EVERY = 10
"""One in so many status reports tells the work offset."""
LOCKED = "[MSG:'$H'|'$X' to unlock]"
BANNER = "Grbl 1.1h ['$' for help]"
STATE = "[GC:G1 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"
VERSION = ["[VER:1.1h.20190830:]", "[OPT:V,15,128]"]


class Controller:
    """A controller that takes bytes by ``receive`` and gives bytes by ``take``.

    ``step`` lets time pass; every ``t`` is a time of the world, s. All methods are called under the
    world's lock. Machine coordinates are the base frame of the rig once the stage is homed, with
    the switches at 0 and the travel below. A reset in motion or a hard limit loses steps: the
    reported position is then wrong until the stage is homed again.
    """

    def __init__(self, world: World, settings: Mapping[str, float] | None = None) -> None:
        """Start in state Idle.

        Args:
            world: The world in which the stage moves.
            settings: Values that replace those of SETTINGS.

        Raises:
            UserError: A setting is unknown.
        """
        changes = dict(settings or {})
        for name in sorted(changes.keys() - SETTINGS.keys()):
            raise UserError(
                f"the emulated GRBL has no setting {name!r}; it has {', '.join(SETTINGS)}."
            )
        self.world, self.settings = world, SETTINGS | changes
        self.state, self.t = "Idle", 0.0
        self.mute, self.garble, self.blind = 0, False, 0
        self._base = matrix(world.rig.work_frame)
        self._lost = np.zeros(3)
        self._out: list[str] = []
        self._clear()

    def _clear(self) -> None:
        self._received = ""
        self._task: Iterator[None] | None = None
        self._halted = False
        self._reports = 0
        self._probed, self._touched = np.zeros(3), False

    # Power, reset and alarms

    def power_up(self, t: float) -> None:
        """Start as when the port is opened: the position is unknown."""
        self.t = t
        self.world.follow(t)
        self._lost = self._true_place()
        self._out.clear()
        self._clear()
        self.state = "Alarm" if self.settings["$22"] else "Idle"
        self._greet()

    def _greet(self) -> None:
        self._out.append("\r\n")
        self._push(BANNER)
        if self.state == "Alarm":
            self._push(LOCKED)

    def reset(self) -> None:
        """Reset as byte 0x18 does; a reset in motion loses the position."""
        if self.state in {"Run", "Jog", "Home"} or (
            self.state == "Hold" and self._task is not None
        ):
            self.lose(3)
        locked = self.state == "Alarm"
        self.world.follow(self.t)
        self._clear()
        self.state = "Alarm" if locked else "Idle"
        self._greet()

    def lose(self, number: int) -> None:
        """Stop at once with an alarm; the motors miss the steps of a way v^2 / 2a."""
        move = self.world.move_at(self.t)
        if move is not None:
            slipped = move.speed(self.t) ** 2 / (2 * self._axes(120).min())
            self._lost = self._lost - self._direction(move) * slipped
        self.alarm(number)

    def alarm(self, number: int) -> None:
        """Stop, send the alarm and lock; after a critical alarm only a reset helps."""
        self.world.follow(self.t)
        self._push(f"ALARM:{number}")
        self.state, self._task = "Alarm", None
        if number in CRITICAL_ALARMS:
            self._halted = True
            self._push("[MSG:Reset to continue]")

    # Bytes

    def receive(self, data: bytes, t: float) -> None:
        """Receive bytes: realtime bytes act at once, all others wait in the buffer."""
        self.step(t)
        for byte in data:
            if byte in b"?!~\x18" or byte >= 0x80:
                self._realtime(byte)
            else:
                self._received += chr(byte)
        self.step(t)

    def _realtime(self, byte: int) -> None:
        if byte == 0x18:
            self.reset()
        elif self._halted:
            return
        elif byte == ord("?") and self.state != "Home":
            self._push(self._report())
        elif byte == ord("!"):
            self.hold()
        elif byte == 0x85 and self.state == "Jog":
            self._cancel_jog()

    def hold(self) -> None:
        """Hold the feed: brake on the way, or cancel a jog."""
        if self.state == "Jog":
            self._cancel_jog()
        elif self.state in {"Idle", "Run"}:
            self._brake()
            self.state = "Hold"

    def _cancel_jog(self) -> None:
        self._brake()
        if self._task is not None:  # a jog that waits for this one is dropped with it
            self._task = None
            self._answer(0)

    def take(self) -> bytes:
        """Return the bytes to send, and remove them from the buffer."""
        out = "".join(self._out).encode("latin-1")
        self._out.clear()
        return out

    def _push(self, text: str) -> None:
        self._out.append(text + "\r\n")

    def _answer(self, error: int) -> None:
        """Send ``ok`` or ``error:N``, unless a fault drops or damages it."""
        text = f"error:{error}" if error else "ok"
        if self.mute:
            self.mute -= 1
            return
        if self.garble:
            self.garble = False
            text = "\xff" + text[1:] + "\x00"
        self._push(text)

    def _report(self) -> str:
        held = ":0" if self.t >= self.world.still_s else ":1"
        state = self.state + (held if self.state == "Hold" else "")
        move = self.world.move_at(self.t)
        speed = 0.0 if move is None else move.speed(self.t)
        fields = [state, f"MPos:{format_axes(self.place)}", f"FS:{math.floor(60 * speed + 0.5)},0"]
        if self._touching():
            fields.append("Pn:P")
        if self._reports % OFFSET_EVERY == 0:
            fields.append("WCO:0.000,0.000,0.000")
        self._reports += 1
        return f"<{'|'.join(fields)}>"

    # Motion

    @property
    def place(self) -> Array:
        """(3,) machine coordinates as the steps were counted, mm."""
        return self._true_place() - self._lost

    def _true_place(self) -> Array:
        return np.asarray((self._base @ self.world.pose_at(self.t))[:3, 3])

    @property
    def moving(self) -> bool:
        """True while the stage moves or a line is carried out, so that ``step`` is needed often."""
        return self.state in {"Run", "Jog", "Home"} or self._task is not None

    def _touching(self) -> bool:
        """Return whether the probe's circuit is closed; that of a broken probe never is."""
        return not self.blind and self.world.depth(self.t) >= 0

    def _go(self, target: Array, rate: float, state: str) -> Iterator[None]:
        """Move to machine coordinates (3,), mm, at ``rate`` mm/s.

        It yields while an earlier move goes on.
        """
        yield from self._standstill()
        steps = self._axes(100)
        way = np.round(target * steps) / steps - self.place
        length = float(np.linalg.norm(way))
        if length == 0:
            return
        start = self.world.pose_at(self.t)
        end = start.copy()
        end[:3, 3] += inverse(self._base)[:3, :3] @ way
        speed = min(rate, _along(self._axes(110) / 60, way / length))
        acceleration = _along(self._axes(120), way / length)
        self.world.follow(self.t, Move.travel(self.t, start, end, speed, acceleration))
        self.state = state

    def _brake(self) -> None:
        move = self.world.move_at(self.t)
        if move is not None:
            self.world.brake(self.t, _along(self._axes(120), self._direction(move)))

    def _direction(self, move: Move) -> Array:
        return np.asarray(self._base[:3, :3] @ (move.end - move.start)[:3, 3] / move.length)

    def _standstill(self) -> Iterator[None]:
        while self.t < self.world.still_s:
            yield

    def step(self, t: float) -> None:
        """Let time pass up to ``t``, and carry out the lines that are due."""
        self.t = max(self.t, t)
        self._come_to_rest()
        while not self._halted and self.state != "Hold":
            if self._task is None and not self._next_line():
                break
            if next(self._task or iter(()), "done") is None:
                break
            self._task = None
        self._come_to_rest()

    def _come_to_rest(self) -> None:
        at_rest = self.t >= self.world.still_s and self._task is None
        if at_rest and self.state in {"Run", "Jog"}:
            self.state = "Idle"

    def _next_line(self) -> bool:
        """Begin with the next line and return True, or False where none is complete."""
        line, end, rest = self._received.partition("\n")
        if not end:
            return False
        self._received = rest
        self._task = self._carry_out(line)
        return True

    def _carry_out(self, line: str) -> Iterator[None]:
        """Carry out one line and answer it; yield while it waits."""
        text = "".join(character for character in line if character > " ").upper()
        try:
            if text.startswith("$J="):
                yield from self._jog(text[3:])
            elif text.startswith("$"):
                yield from self._system(text)
            elif text:
                yield from self._gcode(text)
        except GcodeError as error:
            self._answer(error.args[0])
        else:
            if not self._halted:
                self._answer(0)

    def _system(self, text: str) -> Iterator[None]:
        if text == "$G":  # answered in every state
            self._push(STATE)
            return
        if text not in {"$I", "$$", "$H"}:
            raise GcodeError(STATEMENT)
        if self.state not in {"Idle", "Alarm"}:
            raise GcodeError(NOT_IDLE)
        if text == "$H":
            yield from self._home()
        else:
            for line in VERSION if text == "$I" else self._setting_lines():
                self._push(line)

    def _home(self) -> Iterator[None]:
        """Move to the switches at 0, Z first, then X and Y, and back by the pull-off."""
        if not self.settings["$22"]:
            raise GcodeError(HOMING_OFF)
        self.state, self._lost = "Home", np.zeros(3)
        for chosen in ([2], [0, 1]):
            for height in (0.0, -self.settings["$27"]):
                target = self.place.copy()
                target[chosen] = height
                yield from self._go(target, self.settings["$25"] / 60, "Home")
                yield from self._standstill()
        self.state = "Idle"

    def _jog(self, text: str) -> Iterator[None]:
        if self.state not in {"Idle", "Jog"}:
            raise GcodeError(NOT_IDLE)
        codes, values = parse_words(text)
        if not codes <= {"G21", "G53", "G90", "G91"} or not values.get("F"):
            raise GcodeError(UNSUPPORTED)
        target = self._target(codes, values)
        if not self._within(target):
            raise GcodeError(JOG_TRAVEL)
        yield from self._go(target, values["F"] / 60, "Jog")

    def _gcode(self, text: str) -> Iterator[None]:
        if self.state in {"Alarm", "Jog"}:
            raise GcodeError(NO_G_CODE)
        codes, values = parse_words(text)
        probes = "G38.3" in codes
        if not codes <= {"G21", "G90", "G91", "G38.3"} or probes != bool(values.get("F")):
            raise GcodeError(UNSUPPORTED)
        if probes:
            yield from self._probe(self._target(codes, values), values["F"] / 60)

    def _probe(self, target: Array, rate: float) -> Iterator[None]:
        """Move until the tool touches, and report the place of touch as ``[PRB:...]``."""
        if not self._within(target) or self._touching():
            self.alarm(4 if self._within(target) else 2)
            return
        self._probed, self._touched = np.zeros(3), False
        watch = None if self.blind else self.world.watch(Watch("depth", 0.0, self._on_touch))
        yield from self._go(target, rate, "Run")
        yield from self._standstill()
        if watch is None:
            self.blind -= 1
        else:
            self.world.forget(watch)
        self._push(f"[PRB:{format_axes(self._probed)}:{int(self._touched)}]")

    def _on_touch(self, t: float) -> None:
        self.t = max(self.t, t)
        self._probed, self._touched = self.place, True
        self._brake()

    def _target(self, codes: set[str], values: dict[str, float]) -> Array:
        """Return the machine coordinates (3,), mm, of a line's axis words."""
        axes = {k: values[axis] for k, axis in enumerate("XYZ") if axis in values}
        if not axes:
            raise GcodeError(UNSUPPORTED)
        planned = self._base @ self.world.pose_at(max(self.t, self.world.still_s))
        target = np.asarray(planned[:3, 3] - self._lost)
        for axis, value in axes.items():
            target[axis] = value + (target[axis] if "G91" in codes else 0.0)
        return target

    def _setting_lines(self) -> list[str]:
        integers = {"$13", "$20", "$21", "$22"}
        return [
            f"{name}={value:.0f}" if name in integers else f"{name}={value:.3f}"
            for name, value in self.settings.items()
        ]

    def _axes(self, first: int) -> Array:
        """Return the settings (3,) of x, y and z of a group such as 110."""
        return np.array([self.settings[f"${first + k}"] for k in range(3)])

    def _within(self, target: Array) -> bool:
        """Return whether a target keeps to the soft limits, or these are off."""
        inside = bool(((target <= 1e-9) & (target >= -self._axes(130) - 1e-9)).all())
        return inside or not self.settings["$20"]


def _along(limits: Array, unit: Array) -> float:
    """Return the most along a unit vector (3,) that keeps every axis within its limit (3,)."""
    used = np.abs(unit) > 1e-12
    return float((limits[used] / np.abs(unit[used])).min())
