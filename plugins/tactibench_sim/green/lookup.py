"""Compiled look-ups in the kernel: tableaus of a cap size, softening under load, influence."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim.compiled import jit

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.signedinteger[Any]]


@jit
def cubic_row(knots: Array, x: float) -> tuple[int, float]:
    """Return the cell and the place in it of x on ascending knots, clamped to their ends."""
    x = min(max(x, knots[0]), knots[-1])
    cell = 0
    while cell < len(knots) - 2 and x >= knots[cell + 1]:
        cell += 1
    return cell, x - knots[cell]


@jit
def at_cap(log_cap: Array, caps: Array, cap: float) -> Array:
    """Return the (C, 4, 4) tableau of the linear response to a cap of radius ``cap`` mm."""
    cell, x = cubic_row(log_cap, math.log(cap))
    a, b, c, d = caps[0, cell], caps[1, cell], caps[2, cell], caps[3, cell]
    out: Array = ((a * x + b) * x + c) * x + d
    return out


@jit
def at_force(knots: Array, shares: Array, force: float) -> Array:
    """Return (M,) shares of the softening modes at a force, E_skin mm^2; constant past its end."""
    cell, x = cubic_row(knots, force)
    a, b, c, d = shares[0, cell], shares[1, cell], shares[2, cell], shares[3, cell]
    out: Array = ((a * x + b) * x + c) * x + d
    return out


@jit
def value(tableau: Array, quantity: int, chord: float, step: float) -> float:
    """Return one quantity at a chord; zero beyond the rim."""
    cell = int(chord / step)
    if cell >= tableau.shape[0]:
        return 0.0
    x = chord - cell * step
    c = tableau[cell, quantity]
    out: float = ((c[3] * x + c[2]) * x + c[1]) * x + c[0]
    return out


@jit
def chord_of(a: Array, b: Array) -> float:
    """Return the distance of two unit vectors, by difference, which is exact for close ones."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return math.sqrt(x * x + y * y + z * z)


@jit
def share_of_load(chord: float) -> float:
    """Return the share by which a force at a chord softens a place: 1 there, small a dimple away.

    A quarter at 3.6 mm, about the half-width of the dimple of one small cap (assumed).
    """
    x = chord / 0.18
    return 1 / (1 + x * x) ** 2 if x < 50 else 0.0
