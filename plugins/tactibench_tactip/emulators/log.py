"""Everything that moved: stretches with their ends, whether they kept to the envelope, presses."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from tactibench_tactip.emulators.poses import Array, Pose6


@dataclass(frozen=True)
class Envelope:
    """Box of the work frame in which the tool point must stay, mm, and its greatest tilt, deg.

    Written apart from the drivers' own check, so that one can tell on the other. slack_mm: what
    rounding may add.
    """

    x: tuple[float, float] = (-20.0, 20.0)
    y: tuple[float, float] = (-20.0, 20.0)
    z: tuple[float, float] = (-60.0, 6.5)
    tilt: float = 45.0
    slack_mm: float = 1e-3

    def holds(self, poses: Array) -> bool:
        """Whether all of (N, 4, 4) poses in the work frame lie inside."""
        low, high = np.transpose([self.x, self.y, self.z])
        places = poses[:, :3, 3]
        inside = (places >= low - self.slack_mm) & (places <= high + self.slack_mm)
        upright = poses[:, 2, 2] >= math.cos(math.radians(self.tilt)) - 1e-6
        return bool(inside.all() and upright.all())


@dataclass(frozen=True)
class Stretch:
    """A straight way that was travelled, with its ends in time (s of the world) and space.

    inside: whether all of it lay in the envelope. Positions between the ends are on the line, and
    a box is convex; the tilt is checked at every sixteenth.
    """

    start_s: float
    end_s: float
    start: Pose6
    end: Pose6
    inside: bool


@dataclass(frozen=True)
class Press:
    """One time that the tool went deeper than ``World.press_depth_mm``, from touch to release.

    number counts from 1. deepest_mm: greatest depth. tool: there, work frame.
    """

    number: int
    start_s: float
    end_s: float
    deepest_mm: float
    tool: Pose6


@dataclass
class Log:
    """stretches and presses: the latest ones (bounded, so that long runs do not grow);
    outside: all that left the envelope, the first 1000; count: of all stretches ever."""

    stretches: deque[Stretch] = field(default_factory=lambda: deque(maxlen=4096))
    presses: deque[Press] = field(default_factory=lambda: deque(maxlen=16384))
    outside: list[Stretch] = field(default_factory=list)
    count: int = 0

    def add(self, stretch: Stretch) -> None:
        self.count += 1
        self.stretches.append(stretch)
        if not stretch.inside and len(self.outside) < 1000:
            self.outside.append(stretch)
