"""Joint angles of a UR5e: forward by its Denavit-Hartenberg parameters, inverse by Newton's method.

Parameters from Universal Robots, "DH parameters for calculations of kinematics and dynamics".
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from tactibench_tactip.emulators.poses import METRE, Array, rotation_vector

A = (0.0, -425.0, -392.2, 0.0, 0.0, 0.0)
D = (162.5, 0.0, 0.0, 133.3, 99.7, 99.6)
ALPHA = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)
REACH_MM = 850.0
START = (0.0, -1.5, 1.5, -1.5, -1.5, 0.0)
_STEPS, _CLOSE = 40, 1e-9


def frames(q: Array) -> Array:
    """(7, 4, 4) of the base and every joint, mm; the last one is the flange."""
    found = [np.eye(4)]
    for angle, a, d, alpha in zip(q, A, D, ALPHA, strict=True):
        c, s, ca, sa = math.cos(angle), math.sin(angle), math.cos(alpha), math.sin(alpha)
        step = [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
        found.append(found[-1] @ np.array(step))
    return np.array(found)


def flange(q: Array) -> Array:
    """(4, 4) mm."""
    out: Array = frames(q)[-1]
    return out


def joints(target: Array, near: Array) -> Array | None:
    """(6,) rad that bring the flange to (4, 4) mm, from ``near`` on; None where there are none.

    Newton steps on the geometric Jacobian, damped by 1e-6; other starts are tried where the first
    does not lead there.
    """
    if float(np.linalg.norm(target[:3, 3])) > REACH_MM + D[5] + D[4]:
        return None
    found = _newton(target, near)
    if found is not None:
        return found
    for turns in product((-2.0, 0.0, 2.0), (-1.5,), (-1.8, 1.8), (-1.5,)):
        start = np.array([turns[0], turns[1], turns[2], turns[3], -1.5, 0.0])
        found = _newton(target, start)
        if found is not None:
            return found
    return None


def _newton(target: Array, start: Array) -> Array | None:
    q = np.array(start, dtype=np.float64)
    for _ in range(_STEPS):
        at = frames(q)
        here = at[-1]
        error = np.concatenate(
            [
                (target[:3, 3] - here[:3, 3]) / METRE,
                here[:3, :3] @ rotation_vector(here[:3, :3].T @ target[:3, :3]),
            ]
        )
        if float(np.abs(error).max()) < _CLOSE:
            return np.arctan2(np.sin(q), np.cos(q))
        axes = at[:6, :3, 2]
        arms = (here[:3, 3] - at[:6, :3, 3]) / METRE
        jacobian = np.concatenate([np.cross(axes, arms), axes], axis=1).T
        step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-6 * np.eye(6), error)
        q += step * min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-12))
    return None
