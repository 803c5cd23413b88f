"""Depth and force along a leg, and where they pass a level."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactibench_tactip.emulators.motion import Leg
from tactibench_tactip.emulators.poses import Array
from tactibench_tactip.emulators.touch import Touch

NODE_MM = 0.1
"""Depths are worked out so far apart along a leg and joined by lines. A dome of 20 mm under a tip
of 3 mm curves by at most 0.1^2 / (8 * 23) mm between two of them, 0.05 micrometres."""
MOST_NODES = 4097


@dataclass(frozen=True)
class Level:
    """Something that is told when the depth (mm) or the force (N) passes ``value``, going up or
    down. Told once."""

    quantity: str
    value: float
    told: Callable[[float], None]
    down: bool = False


@dataclass(frozen=True, eq=False)
class Way:
    """A leg with depth (deepest tip) and force along it."""

    leg: Leg
    nodes: Array
    depth: Array
    force: Array

    @classmethod
    def of(cls, leg: Leg, touch: Touch) -> Way:
        length = leg.profile.way
        count = min(math.ceil(length / NODE_MM) + 2, MOST_NODES)
        nodes = np.linspace(0.0, length, count)
        depths = touch.depths(leg.line.many(nodes))
        return cls(leg, nodes, depths.max(axis=1), touch.forces(depths))

    def crossing(self, level: Level, start: float, end: float) -> float | None:
        """Way in (start, end] at which the level is first passed, None: it is not."""
        inner = self.nodes[(self.nodes > start) & (self.nodes < end)]
        at = np.concatenate([[start], inner, [end]])
        with np.errstate(invalid="ignore"):  # beside the dome the depth is minus infinity
            values = np.interp(at, self.nodes, getattr(self, level.quantity))
        above = (values - level.value) * (-1.0 if level.down else 1.0)
        passed = np.flatnonzero((above[1:] >= 0) & ~(above[:-1] >= 0))
        if not len(passed):
            return None
        k = int(passed[0])
        low, high = float(above[k]), float(above[k + 1])
        share = -low / (high - low) if math.isfinite(low) else 1.0
        return float(at[k] + share * (at[k + 1] - at[k]))
