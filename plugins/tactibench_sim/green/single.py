"""One contact alone: rings of force around it, for every depth, as tableaus.

Under a plate the gap is taken where the skin is, displaced along the dome too: a point that stood
at polar angle theta is at theta + atan(t / (R_d - w)) and must be inside of the plate there. Under
spheres, whose contacts are small, this was measured to change nothing for the better.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactibench import UserError
from tactibench_sim.compiled import jit
from tactibench_sim.green.complementarity import solve
from tactibench_sim.green.kernel import Kernel, tableau
from tactibench_sim.green.lookup import Array, at_cap, at_force, share_of_load, value

RINGS = 20
AROUND = 24
"""Quadrature points on half a ring."""
CAP = 2.5
"""Radius of the caps in ring spacings."""
FINEST_MM = 0.06
"""Smallest spacing: the kernel's smallest cap has 0.15 mm."""


@jit
def reach(theta: float, radius: float, delta: float, dome: float) -> float:
    """Return the distance, mm, from the dome's centre to the indenter ``theta`` from its axis.

    The sphere ends a rod along the axis for delta > radius. A very large number where it is missed.
    """
    cosine, sine = math.cos(theta), math.sin(theta)
    if math.isinf(radius):
        return (dome - delta) / cosine if cosine > 0.05 else 1e9
    height = dome + radius - delta
    across = height * sine
    if across < radius:
        along = height * cosine - math.sqrt(radius * radius - across * across)
        if along * cosine <= height:
            return along
    if sine > 1e-9 and radius / sine * cosine > height:
        return radius / sine
    return 1e9


@jit
def ring_average(table: Array, quantity: int, from_: float, to: float, step: float) -> float:
    """Return the mean over a ring at polar angle ``from_`` of a quantity at polar angle ``to``.

    Odd quantities (t) are turned into the meridian of ``to``.
    """
    total = 0.0
    for k in range(AROUND):
        phi = math.pi * (k + 0.5) / AROUND
        half = math.sin((to - from_) / 2) ** 2
        half += math.sin(from_) * math.sin(to) * math.sin(phi / 2) ** 2
        v = value(table, quantity, 2 * math.sqrt(half), step)
        if quantity == 1 or quantity == 3:
            # the component of b cos - m along e_theta
            v *= math.sin(to) * math.cos(from_) - math.cos(to) * math.sin(from_) * math.cos(phi)
        total += v
    return total / AROUND


@jit
def ring_matrix(table: Array, quantity: int, from_: Array, to: Array, step: float) -> Array:
    """Return ``ring_average`` from every ring (N,) to every angle (M,): (M, N)."""
    out = np.empty((len(to), len(from_)))
    for i in range(len(to)):
        for j in range(len(from_)):
            out[i, j] = ring_average(table, quantity, from_[j], to[i], step)
    return out


@dataclass(frozen=True, eq=False)
class Ring:
    """Forces (N,) on rings at polar angles (N,), the cap radius mm, the load that softens."""

    force: Array
    theta: Array
    cap: float
    load: float


def footprint(radius: float, delta: float, dome: float) -> float:
    """Return the radius, mm, within which a contact surely lies: a part of the overlap circle."""
    if math.isinf(radius):
        return 0.8 * math.sqrt(2 * dome * delta)
    overlap = math.sqrt(2 * radius * dome / (radius + dome) * delta)
    return min(min(0.42 + 0.05 * delta, 0.72) * overlap, radius)


def press(kernel: Kernel, radius: float, delta: float) -> Ring:
    """Return the rings of force of one contact. Raises UserError where it does not converge."""
    follow = math.isinf(radius)
    dome = kernel.outer
    spacing = max(footprint(radius, delta, dome) / RINGS, FINEST_MM)
    theta: Array = np.arange(RINGS, dtype=np.float64) * (spacing / dome)
    cap = CAP * spacing
    table = at_cap(kernel.log_cap, kernel.caps, cap)
    parts = [table, *kernel.modes]
    w, t = (
        [ring_matrix(part, quantity, theta, theta, kernel.step) for part in parts]
        for quantity in (0, 1)
    )
    weight = np.array([share_of_load(2 * math.sin(a / 2)) for a in theta])
    load, moved, active = 0.0, np.zeros(RINGS), np.zeros(RINGS, dtype=np.bool_)
    active[0] = True
    force = np.zeros(RINGS)
    for _ in range(200):
        share = at_force(kernel.force, kernel.shares, load)
        a = w[0] + sum(s * m for s, m in zip(share, w[1:], strict=True))
        a = (a + a.T) / 2 + 1e-10 * np.diag(np.diag(a))
        depth = _target_displacement(radius, delta, dome, theta, moved)
        force, fine = solve(a, depth, active)
        if not fine:
            break
        t_now = t[0] + sum(s * m for s, m in zip(share, t[1:], strict=True))
        shift = np.arctan(t_now @ force / (dome - a @ force)) if follow else moved
        change = max(abs(shift - moved).max(), abs(weight @ force - load))
        load, moved = (load + float(weight @ force)) / 2, (moved + shift) / 2
        if change < 1e-10:
            return Ring(force, theta, cap, float(load))
    raise UserError(
        f"the single contact of radius {radius:g} mm at depth {delta:g} mm did not converge; "
        "press less deep or use another tier."
    )


def _target_displacement(
    radius: float, delta: float, dome: float, theta: Array, moved: Array
) -> Array:
    """Return the inward displacement at which each ring, moved along the dome, meets the tip."""
    out = np.empty(len(theta))
    for k in range(len(theta)):
        out[k] = dome - reach(theta[k] + moved[k], radius, delta, dome) * math.cos(moved[k])
    return out


def field(kernel: Kernel, ring: Ring) -> Array:
    """Return the (C, 4, 4) tableau of one contact, mm."""
    chord, polar = polar_samples(kernel)
    share = at_force(kernel.force, kernel.shares, ring.load)
    table = at_cap(kernel.log_cap, kernel.caps, ring.cap)
    table = table + (share[:, None, None, None] * kernel.modes).sum(axis=0)
    rows = [
        ring_matrix(table, quantity, ring.theta, polar, kernel.step) @ ring.force
        for quantity in range(4)
    ]
    return tableau(chord, np.stack(rows))


def polar_samples(kernel: Kernel) -> tuple[Array, Array]:
    """Return the kernel's chords, from the force to the rim, and their polar angles, rad."""
    chord = np.arange(kernel.modes.shape[1] + 1) * kernel.step
    return chord, 2 * np.arcsin(np.minimum(chord / 2, math.sqrt(0.5)))
