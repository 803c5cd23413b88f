"""The dome pressed on its apex."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tactibench_sim.fem.axisymmetric import Array, AxisymmetricPress
from tactibench_sim.fem.bodies import Dome
from tactibench_sim.fem.continuation import Settings
from tactibench_sim.fem.meshes import dome_meridian


@dataclass(frozen=True, eq=False)
class Profile:
    """One converged state, sampled along two meridians at the polar angles asked for.

    inner, outer: (2, T) inward normal and tangential (away from the contact) displacement, mm.
    force: total along the axis, E_skin mm^2.
    """

    delta: float
    force: float
    inner: Array
    outer: Array


def press(
    dome: Dome,
    radius: float,
    deltas: Array,
    polar: Array,
    *,
    friction: str = "none",
    settings: Settings | None = None,
) -> Iterator[Profile]:
    """Press a sphere of ``radius`` mm (inf: a plate) on the apex to each of ``deltas``, ascending.

    polar: (T,) sampling angles, rad, 0..pi/2. For depths beyond its radius the sphere is the end of
    a vertical rod. friction: "none", or "stick": no slip once touching, exact in the limit of small
    increments (``friction.STEP_MM``). Raises NotConvergedError; UserError without NGSolve.
    """
    mesh = dome_meridian(dome)
    problem = AxisymmetricPress(
        mesh, dome.moduli, dome.outer, radius, dome.penalty, settings, friction
    )
    for delta in deltas:
        problem.advance(float(delta))
        inner = _meridian(problem, dome.inner, polar)
        outer = _meridian(problem, dome.outer - 1e-5, polar)
        yield Profile(float(delta), problem.force(), inner, outer)


def _meridian(problem: AxisymmetricPress, radius: float, polar: Array) -> Array:
    """(2, T) inward and tangential displacement at undeformed points, mm."""
    angle = np.clip(polar, 1e-7, math.pi / 2 - 1e-7)
    sine, cosine = np.sin(angle), np.cos(angle)
    u = problem.displacement(radius * sine, radius * cosine)
    inward = -(u[:, 0] * sine + u[:, 1] * cosine)
    along = u[:, 0] * cosine - u[:, 1] * sine
    along[polar == 0] = 0.0
    return np.stack([inward, along])
