"""Straight ways in scaled time: profiles of constant accelerations, and legs that follow them."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactibench_tactip.emulators.poses import Array, rotation_vector, rotations


@dataclass(frozen=True)
class Phase:
    """Constant acceleration: from ``way`` mm and ``speed`` mm/s at ``start`` s, for ``seconds``."""

    start: float
    seconds: float
    way: float
    speed: float
    acceleration: float

    def at(self, t: float) -> tuple[float, float]:
        """(way, speed) at a time of this phase: s + v t + a t^2 / 2, v + a t."""
        t -= self.start
        return (
            self.way + self.speed * t + self.acceleration * t * t / 2,
            self.speed + self.acceleration * t,
        )


@dataclass(frozen=True)
class Profile:
    """Way along a line against time since its start; phases follow each other."""

    phases: tuple[Phase, ...]

    @cached_property
    def seconds(self) -> float:
        return self.phases[-1].start + self.phases[-1].seconds if self.phases else 0.0

    @cached_property
    def way(self) -> float:
        """All of it, mm."""
        return self.phases[-1].at(self.seconds)[0] if self.phases else 0.0

    def at(self, t: float) -> tuple[float, float]:
        """(way mm, speed mm/s) after t s; before it starts (0, first speed), at its end (way, last
        speed)."""
        if not self.phases:
            return 0.0, 0.0
        t = min(max(t, 0.0), self.seconds)
        return self.phases[bisect_right(self._starts, t) - 1].at(t)

    def when(self, way: float) -> float:
        """The first time at which it has come ``way`` mm far; its end where it never does."""
        for phase in self.phases:
            if phase.at(phase.start + phase.seconds)[0] >= way:
                return phase.start + _first_root(phase, way - phase.way)
        return self.seconds

    @cached_property
    def _starts(self) -> list[float]:
        return [phase.start for phase in self.phases]


def _first_root(phase: Phase, way: float) -> float:
    """Smallest t >= 0 with v t + a t^2 / 2 = way, in the form that does not cancel."""
    if way <= 0:
        return 0.0
    square = max(phase.speed**2 + 2 * phase.acceleration * way, 0.0)
    below = phase.speed + math.sqrt(square)
    return min(2 * way / below, phase.seconds) if below > 0 else phase.seconds


def trapezoid(
    length: float, speed: float, acceleration: float, first: float = 0.0, last: float = 0.0
) -> Profile:
    """The fastest way over ``length`` mm: from speed ``first`` to ``last`` (mm/s), never above
    ``speed`` but for a start above it, with ``acceleration`` mm/s2 and its negative.

    peak^2 = a L + (first^2 + last^2) / 2 where ``speed`` is not reached. Where the length is too
    short to brake to ``last``, it brakes harder; too short to reach it, it ends slower.
    """
    if length <= 0:
        return Profile(())
    first, last = max(first, 0.0), max(min(last, speed), 0.0)
    if first * first - last * last >= 2 * acceleration * length:
        return _joined([(first, last, (first * first - last * last) / (2 * length))])
    last = min(last, math.sqrt(first * first + 2 * acceleration * length))
    if first > speed:
        ramps = [(first, speed), (speed, last)]
    else:
        peak = min(speed, math.sqrt(acceleration * length + (first**2 + last**2) / 2))
        ramps = [(first, peak), (peak, last)]
    gone = sum(abs(b * b - a * a) / (2 * acceleration) for a, b in ramps)
    between = ramps[0][1]
    steps = [(*ramps[0], acceleration), (*ramps[1], acceleration)]
    return _joined(steps, cruise=(max(length - gone, 0.0), between))


def braking(speed: float, deceleration: float) -> Profile:
    """To rest over v^2 / 2a."""
    return _joined([(speed, 0.0, deceleration)]) if speed > 0 else Profile(())


def _joined(
    steps: list[tuple[float, float, float]], cruise: tuple[float, float] = (0.0, 0.0)
) -> Profile:
    """Ramps (from, to, |a|) in order; ``cruise`` (way, speed) after the first."""
    phases: list[Phase] = []
    t = way = 0.0
    for number, (a, b, rate) in enumerate(steps):
        if a != b:
            seconds = abs(b - a) / rate
            phases.append(Phase(t, seconds, way, a, math.copysign(rate, b - a)))
            t, way = t + seconds, way + (a + b) / 2 * seconds
        if number == 0 and cruise[0] > 0 and cruise[1] > 0:
            phases.append(Phase(t, cruise[0] / cruise[1], way, cruise[1], 0.0))
            t, way = t + cruise[0] / cruise[1], way + cruise[0]
    return Profile(tuple(phases))


MM_PER_RADIAN = 200.0
"""What a turn counts beside the way of the tool point: the longer of the two sets the time. The
controllers' manuals give no figure; this is an assumption."""


@dataclass(frozen=True, eq=False)
class Line:
    """A straight way between two (4, 4) poses; the orientation turns about one axis."""

    start: Array
    end: Array

    @cached_property
    def length(self) -> float:
        """mm: of the tool point's way, or of the turn where that is longer."""
        way = float(np.linalg.norm(self.end[:3, 3] - self.start[:3, 3]))
        return max(way, self.angle * MM_PER_RADIAN)

    @cached_property
    def angle(self) -> float:
        """rad."""
        if np.array_equal(self.start[:3, :3], self.end[:3, :3]):
            return 0.0
        angle = float(np.linalg.norm(self._turn))
        return angle if angle > 1e-9 else 0.0

    @cached_property
    def _turn(self) -> Array:
        return rotation_vector(self.start[:3, :3].T @ self.end[:3, :3])

    def at(self, way: float) -> Array:
        """(4, 4) after ``way`` mm of its length."""
        return self.many(np.array([way]))[0]

    def many(self, ways: Array) -> Array:
        """(N, 4, 4) after ``ways`` (N,); all at once, since a turn of an arm has thousands."""
        share = np.clip(ways / self.length, 0.0, 1.0) if self.length > 0 else np.ones(len(ways))
        out = np.broadcast_to(self.start, (len(ways), 4, 4)).copy()
        out[:, :3, 3] += share[:, None] * (self.end[:3, 3] - self.start[:3, 3])
        if self.angle:
            out[:, :3, :3] = self.start[:3, :3] @ rotations(self._turn, share)
        return out


@dataclass(frozen=True, eq=False)
class Leg:
    """A line that is followed from ``start_s`` on by a profile. A profile that ends before the line
    does stops there."""

    start_s: float
    line: Line
    profile: Profile

    @property
    def end_s(self) -> float:
        return self.start_s + self.profile.seconds

    def way(self, t: float) -> float:
        return self.profile.at(t - self.start_s)[0]

    def speed(self, t: float) -> float:
        """mm/s along the line; 0 beyond its ends."""
        inside = self.start_s <= t < self.end_s
        return self.profile.at(t - self.start_s)[1] if inside else 0.0

    def at(self, t: float) -> Array:
        """(4, 4) at a time of the world."""
        return self.line.at(self.way(t))

    def when(self, way: float) -> float:
        return self.start_s + self.profile.when(way)
