"""The parser's state: modes, offsets, feed; millimetres."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tactibench_tactip.emulators.grbl.words import Words
from tactibench_tactip.emulators.poses import Array

INCH = 25.4
SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59")


@dataclass
class Modes:
    """position: (3,) where the last planned move ends, machine coordinates."""

    motion: str = "G0"
    distance: str = "G90"
    units: str = "G21"
    system: str = "G54"
    spindle: str = "M5"
    coolant: str = "M9"
    plane: str = "G17"
    feed: float = 0.0
    speed: float = 0.0
    position: Array = field(default_factory=lambda: np.zeros(3))
    shift: Array = field(default_factory=lambda: np.zeros(3))

    def target(self, words: Words, systems: dict[str, Array]) -> Array:
        """(3,) machine coordinates of a line's axis words in its own or the current modes."""
        unit = INCH if words.codes.get("units", self.units) == "G20" else 1.0
        relative = words.codes.get("distance", self.distance) == "G91"
        out = self.position.copy()
        system = systems[words.codes.get("system", self.system)]
        for axis, value in words.axes.items():
            if words.codes.get("once") == "G53":
                out[axis] = value * unit
            elif relative:
                out[axis] += value * unit
            else:
                out[axis] = value * unit + system[axis] + self.shift[axis]
        return out

    def line(self) -> str:
        """What ``$G`` prints."""
        modes = f"{self.motion} {self.system} {self.plane} {self.units} {self.distance} G94"
        feed = self.feed / (INCH if self.units == "G20" else 1.0)
        return f"[GC:{modes} {self.spindle} {self.coolant} T0 F{feed:g} S{self.speed:g}]"
