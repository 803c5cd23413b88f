"""A flat pad pressed by a sphere: the flat planar sensor, and the block of Sneddon's solution."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tactibench import UserError
from tactibench_sim.fem.axisymmetric import Array, AxisymmetricPress
from tactibench_sim.fem.bodies import Pad
from tactibench_sim.fem.continuation import Settings
from tactibench_sim.fem.meshes import pad_meridian


@dataclass(frozen=True, eq=False)
class PadProfile:
    """One converged state at the undeformed distances from the axis asked for.

    surface, marker: (2, N) displacement w into the pad and t away from the axis, mm, on the surface
    and marker_depth below it. force: along the axis, E_skin mm^2.
    """

    delta: float
    force: float
    surface: Array
    marker: Array


def press_pad(
    pad: Pad, radius: float, deltas: Array, r: Array, *, settings: Settings | None = None
) -> Iterator[PadProfile]:
    """Press a sphere of ``radius`` mm on the pad's axis to each of ``deltas``, ascending.

    r: (N,) distances from the axis, mm, 0..width / 2. For depths beyond its radius the sphere is
    the end of a rod. Raises UserError for a plate (all of a flat pad would touch at once),
    NotConvergedError, UserError without NGSolve.
    """
    if math.isinf(radius):
        raise UserError("a flat pad is pressed by spheres only; give a finite radius.")
    problem = AxisymmetricPress(
        pad_meridian(pad), pad.moduli, pad.thickness, radius, pad.penalty, settings
    )
    for delta in deltas:
        problem.advance(float(delta))
        surface = _level(problem, pad, r, 0.0)
        marker = _level(problem, pad, r, pad.marker_depth)
        yield PadProfile(float(delta), problem.force(), surface, marker)


def _level(problem: AxisymmetricPress, pad: Pad, r: Array, below: float) -> Array:
    """(2, N) displacement into the pad and away from the axis, ``below`` its surface, mm."""
    inside = 1e-7 * pad.width
    x = np.clip(r, inside, pad.width / 2 - inside)
    y = np.full_like(x, min(pad.thickness - below, pad.thickness - inside))
    u = problem.displacement(x, y)
    along = np.where(r == 0, 0.0, u[:, 0])
    return np.stack([-u[:, 1], along])
