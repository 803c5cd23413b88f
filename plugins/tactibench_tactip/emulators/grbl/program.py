"""Carries out lines: ``$`` commands and G-code, in the order of the firmware's checks.

Every method that takes time is a generator that yields while it waits. Arcs, G28, G30 and tool
lengths are not emulated: error 20.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from tactibench_tactip.emulators.grbl import words as gcode
from tactibench_tactip.emulators.grbl.modes import INCH, SYSTEMS
from tactibench_tactip.emulators.grbl.report import axes
from tactibench_tactip.emulators.grbl.words import GcodeError, Words
from tactibench_tactip.emulators.poses import Array

if TYPE_CHECKING:
    from tactibench_tactip.emulators.grbl.controller import Controller

BAD_STATEMENT, HOMING_OFF, NOT_IDLE, LOCKED, JOG_TRAVEL = 3, 5, 8, 9, 15
HELP = "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]"
VERSION = ("[VER:1.1h.20190830:]", "[OPT:V,15,128]")
_JOG_CODES = {"units", "distance"}
_JOG_VALUES = set("XYZFN")


class Program:
    """One line on a controller."""

    def __init__(self, grbl: Controller) -> None:
        self.grbl, self.modes = grbl, grbl.modes

    def line(self, text: str) -> Iterator[None]:
        """Carry out a plain line. Raises GcodeError with the firmware's number."""
        if not text:
            return
        if text.startswith("$"):
            yield from self._system(text)
        elif self.grbl.state in {"Alarm", "Jog"}:
            raise GcodeError(LOCKED)
        else:
            yield from self._gcode(gcode.words(text))

    # $ commands

    def _system(self, text: str) -> Iterator[None]:
        grbl = self.grbl
        if text.startswith("$J"):
            if grbl.state not in {"Idle", "Jog"}:
                raise GcodeError(NOT_IDLE)
            if not text.startswith("$J="):
                raise GcodeError(BAD_STATEMENT)
            yield from self._jog(gcode.words(text[3:]))
            return
        prints: dict[str, Callable[[], list[str]]] = {
            "$": lambda: [HELP],
            "$G": lambda: [self.modes.line()],
            "$$": grbl.settings.lines,
            "$#": self._offsets,
            "$I": lambda: list(VERSION),
            "$N": lambda: ["$N0=", "$N1="],
        }
        busy = grbl.state not in {"Idle", "Alarm", "Check"}
        if text in prints:
            if busy and text not in {"$", "$G"}:
                raise GcodeError(NOT_IDLE)
            for out in prints[text]():
                grbl.push(out)
        elif text == "$X":
            if grbl.state == "Alarm":
                grbl.push("[MSG:Caution: Unlocked]")
                grbl.state = "Idle"
        elif busy:
            raise GcodeError(NOT_IDLE)
        elif text == "$H":
            yield from self._home()
        elif text == "$C":
            self._check_mode()
        elif text == "$SLP":
            grbl.push("[MSG:Sleeping]")
            grbl.state = "Sleep"
        else:
            self._set(text)

    def _check_mode(self) -> None:
        if self.grbl.state == "Check":
            self.grbl.push("[MSG:Disabled]")
            self.grbl.reset()
        elif self.grbl.state == "Alarm":
            raise GcodeError(NOT_IDLE)
        else:
            self.grbl.push("[MSG:Enabled]")
            self.grbl.state = "Check"

    def _set(self, text: str) -> None:
        name, equals, value = text.partition("=")
        if not equals or not name[1:].isdigit():
            raise GcodeError(BAD_STATEMENT)
        error = self.grbl.settings.write(name, value)
        if error:
            raise GcodeError(error)

    def _offsets(self) -> list[str]:
        grbl = self.grbl
        systems = [f"[{name}:{axes(grbl.systems[name])}]" for name in SYSTEMS]
        probe = f"[PRB:{axes(grbl.probed)}:{int(grbl.probe_hit)}]"
        return [*systems, f"[G92:{axes(self.modes.shift)}]", "[TLO:0.000]", probe]

    def _jog(self, words: Words) -> Iterator[None]:
        """$J=: its own feed, cancellable, leaves the parser's modes alone."""
        codes = set(words.codes) - _JOG_CODES - {"once"}
        if codes or words.codes.get("once", "G53") != "G53" or set(words.values) - _JOG_VALUES:
            raise GcodeError(gcode.JOG_ONLY)
        if not words.axes:
            raise GcodeError(gcode.NO_AXES)
        if not words.values.get("F"):
            raise GcodeError(gcode.NO_FEED)
        target = self.modes.target(words, self.grbl.systems)
        if not self.grbl.within(target):
            raise GcodeError(JOG_TRAVEL)
        yield from self._room()
        if not self.grbl.cancelling:
            self.grbl.queue(target, self._rate(words), "Jog")

    def _home(self) -> Iterator[None]:
        """Z first, then X and Y, to the switches at 0 and back by the pull-off."""
        grbl = self.grbl
        if not grbl.settings["$22"]:
            raise GcodeError(HOMING_OFF)
        grbl.state = "Home"
        pull = grbl.settings["$27"]
        grbl.stage.lost = np.zeros(3)
        for chosen in ((2,), (0, 1)):
            for height in (0.0, -pull):
                target = grbl.stage.place(grbl.t).copy()
                target[list(chosen)] = height
                self.modes.position = grbl.stage.place(grbl.t)
                grbl.queue(target, grbl.settings["$25"] / 60, "Home")
                yield from self._standstill()
        grbl.homed, grbl.state = True, "Idle"
        self.modes.position = grbl.stage.place(grbl.t)

    # G-code

    def _gcode(self, words: Words) -> Iterator[None]:
        codes, values = words.codes, words.values
        once = codes.get("once", "")
        motion = codes.get("motion", self.modes.motion)
        moves = bool(words.axes) and once not in {"G10", "G92"}
        self._check(words, motion, once, moves)
        self._set_modes(words)
        if once == "G4":
            yield from self._dwell(values["P"])
        elif once == "G10":
            yield from self._set_system(words)
        elif once in {"G92", "G92.1"}:
            self._shift(words)
        if moves:
            target = self.modes.target(words, self.grbl.systems)
            if motion.startswith("G38"):
                yield from self._probe(target, self.modes.feed / 60, motion == "G38.2")
            else:
                rate = math.inf if motion == "G0" else self.modes.feed / 60
                yield from self._move(target, rate)
        if "program" in codes:
            yield from self._end(codes["program"])

    def _check(self, words: Words, motion: str, once: str, moves: bool) -> None:
        if once == "G4" and "P" not in words.values:
            raise GcodeError(gcode.NO_VALUE)
        if once in {"G10", "G92"} and not words.axes:
            raise GcodeError(gcode.NO_AXES)
        if once in {"G10", "G92", "G4"} and "motion" in words.codes and words.axes:
            raise GcodeError(gcode.TWO_AXIS)
        if motion.startswith("G38") and "motion" in words.codes and not words.axes:
            raise GcodeError(gcode.NO_AXES)
        if moves and motion == "G80":
            raise GcodeError(gcode.AXES_UNUSED)
        if moves and motion != "G0" and not (words.values.get("F") or self.modes.feed):
            raise GcodeError(gcode.NO_FEED)
        used = {"G4": "P", "G10": "LP"}.get(once, "")
        if set(words.values) - set("XYZFNST" + used):
            raise GcodeError(gcode.UNUSED)

    def _set_modes(self, words: Words) -> None:
        for group in ("motion", "distance", "units", "system", "spindle", "coolant", "plane"):
            if group in words.codes:
                setattr(self.modes, group, words.codes[group])
        if "system" in words.codes:
            self.grbl.report.offset_due()
        if "F" in words.values:
            self.modes.feed = self._rate(words) * 60
        self.modes.speed = words.values.get("S", self.modes.speed)

    def _rate(self, words: Words) -> float:
        """mm/s of the F word."""
        inches = words.codes.get("units", self.modes.units) == "G20"
        return words.values["F"] * (INCH if inches else 1.0) / 60

    def _move(self, target: Array, rate: float) -> Iterator[None]:
        grbl = self.grbl
        if grbl.state == "Check":
            return
        if not grbl.within(target):
            yield from self._soft_limit()
            return
        yield from self._room()
        grbl.queue(target, rate)

    def _soft_limit(self) -> Iterator[None]:
        """Brake, then alarm 2; the line gets no answer."""
        grbl = self.grbl
        if len(grbl.planner):
            end = grbl.planner.brake(grbl.t, grbl.limits)
            while grbl.t < end:
                yield
        grbl.alarm(2)

    def _dwell(self, seconds: float) -> Iterator[None]:
        yield from self._standstill()
        end = self.grbl.t + seconds
        while self.grbl.t < end:
            yield

    def _probe(self, target: Array, rate: float, must: bool) -> Iterator[None]:
        """Move until the tool touches; [PRB:...] holds where that was."""
        grbl = self.grbl
        yield from self._standstill()
        if np.allclose(target, self.modes.position):
            raise GcodeError(gcode.TARGET)
        if not grbl.within(target):
            yield from self._soft_limit()
            return
        if grbl.touching():
            grbl.alarm(4)
            return
        number = grbl.listen()
        grbl.queue(target, rate)
        yield from self._standstill()
        grbl.stop_listening(number)
        if not grbl.probe_hit and must:
            grbl.alarm(5)
        grbl.push(f"[PRB:{axes(grbl.probed)}:{int(grbl.probe_hit)}]")
        self.modes.position = grbl.stage.place(grbl.t)

    def _set_system(self, words: Words) -> Iterator[None]:
        """G10 L2: the offset itself; L20: so that the tool is at the values given."""
        kind, number = words.values.get("L"), int(words.values.get("P", 0))
        if kind not in {2, 20} or not 0 <= number <= len(SYSTEMS):
            raise GcodeError(gcode.NOT_SUPPORTED_COORDINATES)
        yield from self._standstill()
        name = SYSTEMS[number - 1] if number else self.modes.system
        unit = INCH if self.modes.units == "G20" else 1.0
        for axis, value in words.axes.items():
            there = self.modes.position[axis] - self.modes.shift[axis] if kind == 20 else 0.0
            sign = -1.0 if kind == 20 else 1.0
            self.grbl.systems[name][axis] = there + sign * value * unit
        self.grbl.report.offset_due()

    def _shift(self, words: Words) -> None:
        """G92: the tool is at the values given; G92.1: no longer."""
        self.modes.shift = self.modes.shift.copy()
        if words.codes["once"] == "G92.1":
            self.modes.shift[:] = 0.0
        unit = INCH if self.modes.units == "G20" else 1.0
        system = self.grbl.systems[self.modes.system]
        for axis, value in words.axes.items():
            self.modes.shift[axis] = self.modes.position[axis] - system[axis] - value * unit
        self.grbl.report.offset_due()

    def _end(self, code: str) -> Iterator[None]:
        yield from self._standstill()
        if code == "M0":
            self.grbl.hold()
            yield
            return
        for mode, value in {"motion": "G1", "distance": "G90", "system": "G54"}.items():
            setattr(self.modes, mode, value)
        self.grbl.push("[MSG:Pgm End]")

    # Waiting

    def _room(self) -> Iterator[None]:
        while self.grbl.planner.full:
            yield

    def _standstill(self) -> Iterator[None]:
        """Until all that is planned is done, or a probe has stopped it."""
        grbl = self.grbl
        while len(grbl.planner):
            if grbl.probe_stopped():
                grbl.planner.clear()
                break
            yield
