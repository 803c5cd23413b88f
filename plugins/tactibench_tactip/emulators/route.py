"""Where the tool is at any time: the legs that it follows, and those that it followed."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence

from tactibench_tactip.emulators.levels import Way
from tactibench_tactip.emulators.motion import Leg, Line, Profile
from tactibench_tactip.emulators.poses import Array
from tactibench_tactip.emulators.touch import Touch

KEPT = 4096
"""Legs of the past that are kept."""


class Route:
    """The legs of the tool: those that were, those that are to come. Not thread-safe."""

    def __init__(self, touch: Touch, start: Array) -> None:
        self.touch = touch
        self._ways: deque[Way] = deque()
        still = Leg(-math.inf, Line(start, start), Profile(()))
        self._past: deque[Leg] = deque([still], maxlen=KEPT)
        self._rest = start
        self._rest_since = -math.inf

    def follow(self, t: float, steps: Iterable[tuple[Array, Profile]]) -> None:
        """From t on go to (4, 4) poses, one after the other; what was planned beyond t is void."""
        here = self.at(t)
        self._cut(t, here)
        for target, profile in steps:
            line = Line(here, target)
            leg = Leg(t, line, profile)
            self._ways.append(Way.of(leg, self.touch))
            t, here = leg.end_s, leg.at(leg.end_s)
        self._rest, self._rest_since = here, t

    def _cut(self, t: float, here: Array) -> None:
        for way in self._ways:
            if way.leg.start_s >= t:
                break
            self._past.append(way.leg)
        if self._ways and t < self._ways[-1].leg.end_s:
            self._past.append(Leg(t, Line(here, here), Profile(())))
        self._ways.clear()

    def changed(self, touch: Touch) -> None:
        """Another indenter."""
        self.touch = touch
        self._ways = deque(Way.of(way.leg, touch) for way in self._ways)

    def at(self, t: float) -> Array:
        """(4, 4) at t. Raises ValueError for a moment that is no longer kept."""
        for way in self._ways:
            if way.leg.start_s <= t < way.leg.end_s:
                return way.leg.at(t)
        if t >= self._rest_since:
            return self._rest
        for leg in reversed(self._past):
            if leg.start_s <= t:
                return leg.at(t)
        raise ValueError(f"where the tool was at {t:.3f} s is no longer kept")

    def ways(self, start: float, end: float) -> Sequence[Way]:
        """Those that are followed between two times."""
        return [w for w in self._ways if w.leg.start_s < end and w.leg.end_s > start]

    @property
    def end_s(self) -> float:
        """When the last leg ends."""
        return self._rest_since

    def leg(self, t: float) -> Leg | None:
        """The leg that is followed at t."""
        for way in self._ways:
            if way.leg.start_s <= t < way.leg.end_s:
                return way.leg
        return None
