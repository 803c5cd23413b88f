"""How long a straight move takes, and how long one waits for it."""

from __future__ import annotations

import math

from tactibench_tactip.geometry.frames import apart, turned_by
from tactibench_tactip.settings import Pose6

TURN_DEG_S = 50.0
"""What a tool is taken to turn with."""


def move_seconds(start: Pose6, end: Pose6, speed: float, acceleration: float) -> float:
    """Of a move from rest to rest with a trapezoid of speed, s; speed mm/s, acceleration mm/s^2.

    Up to v^2 / a the top speed is not reached: t = 2 sqrt(d / a); beyond, t = d / v + v / a.
    """
    distance = apart(start, end)
    if distance < speed**2 / acceleration:
        way = 2.0 * math.sqrt(distance / acceleration)
    else:
        way = distance / speed + speed / acceleration
    return max(way, turned_by(start, end) / TURN_DEG_S)


def patience(expected_s: float, time_scale: float) -> float:
    """Host seconds after which a move is given up: twice what it takes, and 2 s."""
    return 2.0 * expected_s / time_scale + 2.0
