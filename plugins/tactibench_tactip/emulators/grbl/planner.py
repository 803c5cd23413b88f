"""Blocks of motion with look-ahead, as GRBL's planner joins them: its junction deviation."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tactibench_tactip.emulators.grbl.settings import Settings
from tactibench_tactip.emulators.motion import Profile, braking, trapezoid
from tactibench_tactip.emulators.poses import Array

BLOCKS = 15


@dataclass(frozen=True, eq=False)
class Block:
    """A straight move to ``target`` (3,) mm. rate: mm/s as programmed; inf for a rapid."""

    target: Array
    rate: float


@dataclass(frozen=True, eq=False)
class Limits:
    """Greatest rate (mm/s) and acceleration (mm/s2) of every axis, and the junction deviation."""

    rates: Array
    accelerations: Array
    deviation: float

    @classmethod
    def of(cls, settings: Settings) -> Limits:
        return cls(np.array(settings.axes(110)) / 60, np.array(settings.axes(120)), settings["$11"])

    def rate(self, unit: Array) -> float:
        return along(self.rates, unit)

    def acceleration(self, unit: Array) -> float:
        return along(self.accelerations, unit)

    def junction(self, before: Array, after: Array) -> float:
        """mm/s at a corner: v^2 = a d sin(t/2) / (1 - sin(t/2)), t the inner angle (GRBL
        planner.c, after Jens Geisler)."""
        cosine = -float(before @ after)
        if cosine > 0.999999:
            return 0.0
        if cosine < -0.999999:
            return math.inf
        half = math.sqrt((1 - cosine) / 2)
        bend = after - before
        acceleration = self.acceleration(bend / np.linalg.norm(bend))
        return math.sqrt(acceleration * self.deviation * half / (1 - half))


def along(limits: Array, unit: Array) -> float:
    """The most along a unit vector that keeps every axis within its limit."""
    used = np.abs(unit) > 1e-12
    return float((limits[used] / np.abs(unit[used])).min()) if used.any() else math.inf


class Planner:
    """The blocks that are not finished, the first one being carried out.

    place: (3,) machine position at a time, as steps were counted. go: makes the world follow
    targets (3,) by profiles from a time on.
    """

    def __init__(
        self,
        place: Callable[[float], Array],
        speed: Callable[[float], float],
        go: Callable[[float, Sequence[tuple[Array, Profile]]], None],
    ) -> None:
        self._place, self._speed, self._go = place, speed, go
        self._blocks: deque[Block] = deque()
        self._ends: deque[float] = deque()
        self.feed_share, self.rapid_share = 1.0, 1.0

    def __len__(self) -> int:
        return len(self._blocks)

    @property
    def full(self) -> bool:
        return len(self._blocks) >= BLOCKS

    def settle(self, t: float) -> None:
        """Forget what is finished at t."""
        while self._ends and self._ends[0] <= t:
            self._ends.popleft()
            self._blocks.popleft()

    def add(self, block: Block) -> None:
        self._blocks.append(block)

    def clear(self) -> None:
        self._blocks.clear()
        self._ends.clear()

    def run(self, t: float, limits: Limits) -> None:
        """Plan all blocks from where the tool is at t, at the speed that it has."""
        self.settle(t)
        ways = self._ways(t)
        entries = self._entries(ways, limits)
        speed, steps, end = self._speed(t), [], t
        self._ends.clear()
        for k, (block, length, unit) in enumerate(ways):
            rate = self._rate(block, unit, limits)
            last = entries[k + 1]
            profile = trapezoid(length, rate, limits.acceleration(unit), speed, last)
            steps.append((block.target, profile))
            speed = profile.at(profile.seconds)[1] if profile.phases else speed
            end += profile.seconds
            self._ends.append(end)
        self._go(t, steps)

    def brake(self, t: float, limits: Limits) -> float:
        """Come to rest on the planned way as fast as the axes allow; returns when, s."""
        self.settle(t)
        speed, steps, end = self._speed(t), [], t
        self._ends.clear()
        for block, length, unit in self._ways(t):
            rate = limits.acceleration(unit)
            if speed * speed <= 2 * rate * length:
                profile = braking(speed, rate)
                end += profile.seconds
                steps.append((block.target, profile))
                break
            profile = trapezoid(length, speed, rate, speed, math.sqrt(speed**2 - 2 * rate * length))
            speed, end = profile.at(profile.seconds)[1], end + profile.seconds
            steps.append((block.target, profile))
            self._ends.append(end)
        self._go(t, steps)
        return end

    def halt(self, t: float) -> None:
        """Stop at once and forget the blocks."""
        self.clear()
        self._go(t, ())

    def _rate(self, block: Block, unit: Array, limits: Limits) -> float:
        most = limits.rate(unit)
        if math.isinf(block.rate):
            return most * self.rapid_share
        return min(block.rate * self.feed_share, most)

    def _ways(self, t: float) -> list[tuple[Block, float, Array]]:
        """Every block with the length that is left and its direction."""
        found, here = [], self._place(t)
        for block in self._blocks:
            way = block.target - here
            length = float(np.linalg.norm(way))
            found.append((block, length, way / length if length > 0 else way))
            here = block.target
        return found

    def _entries(self, ways: list[tuple[Block, float, Array]], limits: Limits) -> list[float]:
        """Speed at which every block may begin, so that all that follow can brake; 0 at the end."""
        entries = [0.0] * (len(ways) + 1)
        for k in range(len(ways) - 1, 0, -1):
            (before, _, came), (block, length, goes) = ways[k - 1], ways[k]
            corner = limits.junction(came, goes) if came.any() and goes.any() else 0.0
            reach = math.sqrt(entries[k + 1] ** 2 + 2 * limits.acceleration(goes) * length)
            rates = self._rate(before, came, limits), self._rate(block, goes, limits)
            entries[k] = min(corner, reach, *rates)
        return entries
