"""Keeps the log of a route and counts its presses."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from tactibench_tactip.emulators.levels import Level, Way
from tactibench_tactip.emulators.log import Envelope, Log, Press, Stretch
from tactibench_tactip.emulators.poses import pose6
from tactibench_tactip.emulators.route import Route


class Recorder:
    """log: what happened. presses: how many have begun. envelope: None, or what must hold."""

    def __init__(self, route: Route, envelope: Envelope | None, press_depth_mm: float) -> None:
        self.log = Log()
        self.presses = 0
        self.press_depth_mm = press_depth_mm
        self._route = route
        self.envelope = envelope
        self._pressing = False
        self._since = 0.0
        self._deepest = (-math.inf, np.eye(4))

    def is_press(self, number: int) -> bool:
        """Whether the press of that number is on, or is the next."""
        return number == self.presses + (0 if self._pressing else 1)

    def levels(self) -> Iterable[tuple[int, Level]]:
        """What begins and ends a press."""
        if not self._pressing:
            yield -2, Level("depth", self.press_depth_mm, self._begin)
        else:
            yield -2, Level("depth", 0.0, self._release, down=True)

    def record(self, start: float, end: float) -> None:
        """Put what was travelled between two times into the log."""
        for way in self._route.ways(start, end):
            leg = way.leg
            first, last = max(start, leg.start_s), min(end, leg.end_s)
            a, b = leg.way(first), leg.way(last)
            if b <= a:
                continue
            self.log.add(
                Stretch(
                    first,
                    last,
                    pose6(leg.line.at(a)),
                    pose6(leg.line.at(b)),
                    self._inside(way, a, b),
                )
            )
            if self._pressing:
                self._deepen(way, a, b)

    def _inside(self, way: Way, a: float, b: float) -> bool:
        """A box is convex: its ends speak for a line. A turn is looked at in sixteenths."""
        if self.envelope is None:
            return True
        line = way.leg.line
        ways = np.linspace(a, b, 17) if line.angle else np.array([a, b])
        return self.envelope.holds(line.many(ways))

    def _deepen(self, way: Way, a: float, b: float) -> None:
        inner = way.nodes[(way.nodes > a) & (way.nodes < b)]
        at = np.concatenate([[a], inner, [b]])
        depths = np.interp(at, way.nodes, way.depth)
        k = int(depths.argmax())
        if depths[k] > self._deepest[0]:
            self._deepest = float(depths[k]), way.leg.line.at(float(at[k]))

    def _begin(self, t: float) -> None:
        self.presses += 1
        self._pressing, self._since = True, t
        self._deepest = self.press_depth_mm, self._route.at(t)

    def _release(self, t: float) -> None:
        depth, tool = self._deepest
        self.log.presses.append(Press(self.presses, self._since, t, depth, pose6(tool)))
        self._pressing = False
