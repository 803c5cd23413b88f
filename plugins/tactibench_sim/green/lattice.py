"""Nodes where a tip may touch: a hexagonal disc around its axis, turned towards the other tips.

The lattice takes its orientation from the other tips alone (the phase of their six-fold order
parameter), so that turning or mirroring a scene turns or mirrors every node.
"""

from __future__ import annotations

import math

import numpy as np

from tactibench_sim.compiled import jit
from tactibench_sim.green.lookup import Array

RINGS = 4
NODES = 1 + 3 * RINGS * (RINGS + 1)


def hexagon() -> Array:
    """Return (NODES, 2) points of a hexagonal disc, spacing 1, a row along the first axis."""
    cells = [
        (q + r / 2, math.sqrt(3) / 2 * r)
        for r in range(-RINGS, RINGS + 1)
        for q in range(-RINGS, RINGS + 1)
        if abs(q + r) <= RINGS
    ]
    return np.array(sorted(cells, key=lambda p: p[0] ** 2 + p[1] ** 2))


@jit
def basis(n: Array) -> tuple[Array, Array]:
    """Return two unit vectors across n and each other."""
    pole = np.zeros(3)
    pole[np.argmin(np.abs(n))] = 1.0
    first = np.cross(pole, n)
    first /= math.sqrt((first * first).sum())
    return first, np.cross(n, first)


@jit
def orientation(n: Array, weight: Array, tip: int, first: Array, second: Array) -> float:
    """Return the angle of a tip's lattice from ``first``. n: (K, 3), weight: (K,) of the tips."""
    real = imaginary = 0.0
    for j in range(len(n)):
        x, y = (n[j] * first).sum(), (n[j] * second).sum()
        if j == tip or x * x + y * y < 1e-18:
            continue
        angle = 6 * math.atan2(y, x)
        real += weight[j] * math.cos(angle)
        imaginary += weight[j] * math.sin(angle)
    if real * real + imaginary * imaginary < 1e-24:
        return 0.0
    return math.atan2(imaginary, real) / 6


@jit
def nodes(hexagon: Array, n: Array, weight: Array, spacing: Array, dome: float) -> Array:
    """Return (K, NODES, 3) directions; spacing: (K,) mm along the dome."""
    out = np.empty((len(n), len(hexagon), 3))
    for i in range(len(n)):
        first, second = basis(n[i])
        turn = orientation(n, weight, i, first, second)
        cosine, sine = math.cos(turn), math.sin(turn)
        for k in range(len(hexagon)):
            x = cosine * hexagon[k, 0] - sine * hexagon[k, 1]
            y = sine * hexagon[k, 0] + cosine * hexagon[k, 1]
            size = math.sqrt(x * x + y * y)
            angle = size * spacing[i] / dome
            across = math.sin(angle) / size if size > 0 else 0.0
            for c in range(3):
                out[i, k, c] = math.cos(angle) * n[i, c] + across * (x * first[c] + y * second[c])
    return out
