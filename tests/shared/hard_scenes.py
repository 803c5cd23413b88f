"""Sensors, scenes and parameters that the tests of hard cases share."""

import math
from functools import cache

import numpy as np
import pytest

from tactibench import Grid, SensorContext
from tactibench_sim import TacTip127, Tips, layout

RADII = (3.0, math.inf)
PINS = layout(127).copy()  # scipy turns no array that is read-only
NONE = (0.0, 0.0, -math.inf)
GRID = Grid.centred(32, 0.6)


@cache
def sensor(tier):
    given = {"tier": tier, "noise": False, "friction": 0.0, "size": 96}
    return TacTip127(SensorContext(np.random.SeedSequence(0)), **given)


@cache
def dome(tier):
    return sensor(tier).mechanics


every_tier = pytest.mark.parametrize("tier", ["coupled", "superpose"])
coupled_tier = pytest.mark.parametrize("tier", ["coupled"])
"""Tier superpose adds contacts as if each were alone."""
every_radius = pytest.mark.parametrize("radius", RADII, ids=["sphere", "plate"])


def tips(*contacts, radius=3.0):
    """One scene of (x, y, depth)."""
    array = np.array([contacts], dtype=float)
    return Tips(array[..., :2], array[..., 2], np.array([radius]))


def towards(n, delta, radius=3.0):
    """Contacts with directions n (K, 3) and penetrations delta (K,), as (x, y, depth)."""
    if math.isinf(radius):
        return [(20 * x, 20 * y, d) for (x, y, _), d in zip(n, delta, strict=True)]
    centres = (20 + radius - np.asarray(delta))[:, None] * np.asarray(n)
    touch = np.sqrt((20 + radius) ** 2 - (centres[:, :2] ** 2).sum(axis=1))
    return [(x, y, h - z) for (x, y, z), h in zip(centres, touch, strict=True)]


def slanted(degrees, delta, radius=3.0, azimuth=0.3):
    """One contact at a polar angle."""
    a = math.radians(degrees)
    sine = math.sin(a)
    n = [(sine * math.cos(azimuth), sine * math.sin(azimuth), math.cos(a))]
    return towards(n, np.array([delta]), radius)[0]


def moved(tier, *contacts, radius=3.0, at=PINS):
    """(P, 3) displacement of pin bases, mm."""
    mechanics = dome(tier)
    return mechanics.displacement(mechanics.loads(tips(*contacts, radius=radius)), at)[0][0]


def pins(tier, *contacts, radius=3.0):
    mechanics = dome(tier)
    return mechanics.pin_tips(mechanics.loads(tips(*contacts, radius=radius)), PINS, 2.0)[0]


def carried(tier, *contacts):
    """(K,) how much each contact carries: force, or amplitude of its single field."""
    (part,) = dome(tier).loads(tips(*contacts))
    return part.amplitude[0]


def clean(tier, *contacts, radius=3.0):
    """(H, W) grey levels before rounding."""
    return sensor(tier).clean(tips(*contacts, radius=radius))[0]


def worst_jump(field, start, end, steps):
    """Largest change of a field over a vanishing part of [start, end].

    Looked for by bisection where it changes most from step to step.
    """
    values = np.linspace(start, end, steps + 1)
    fields = np.array([field(v) for v in values])
    change = abs(np.diff(fields, axis=0)).reshape(steps, -1).max(axis=1)
    worst = 0.0
    for k in np.argsort(change)[-2:]:
        (low, high), (before, after) = values[k : k + 2], fields[k : k + 2]
        while high - low > 1e-7:
            middle = (low + high) / 2
            between = field(middle)
            if abs(between - before).max() > abs(after - between).max():
                high, after = middle, between
            else:
                low, before = middle, between
        worst = max(worst, abs(after - before).max())
    return worst


def enclosed_volume(radius, polar, w, t):
    """Volume below a displaced meridian, mm^3: pi * integral of rho^2 dz."""
    fine = np.linspace(0, polar[-1], 6001)
    w, t = np.interp(fine, polar, w), np.interp(fine, polar, t)
    rho = (radius - w) * np.sin(fine) + t * np.cos(fine)
    z = (radius - w) * np.cos(fine) - t * np.sin(fine)
    middle = (rho[1:] ** 2 + rho[1:] * rho[:-1] + rho[:-1] ** 2) / 3
    return -math.pi * (middle * np.diff(z)).sum()
