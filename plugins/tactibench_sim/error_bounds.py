"""Measured error bounds: how far a pin of a scene may be from finite elements.

The file that ships holds what scripts/fem/error_bounds.py measured: the tables that ship against
all scenes that were computed by finite elements. The bound is an *envelope*, a sum of terms that
grow with depth, steepness, number of contacts and friction (``envelope_terms``), with the smallest
coefficients that hold every scene, times a factor that makes it hold also for runs that were left
out when the coefficients were found. The terms of friction hold what scenes with friction are off
beyond half the bound of the others. Tips of R = 3 mm, sharper and blunter ones have envelopes of
their own: one of all scenes of one contact, one of those of several. Several contacts are not taken
to be more exact than one.

The error of a pin's tip grows with the pin. The tip of a pin of length L is off by |b - L t|, with
b the error of the base, mm, and t that of the normal there. This is convex in L, and so is the
largest over all pins. With bounds of the bases, e(0), and of tips of pins of LEVER_MM, e(1), it is
at most

    e(L) <= e(0) + L / LEVER_MM (e(1) - e(0))     for pins up to LEVER_MM,
    e(L) <= e(1) + (L / LEVER_MM - 1) (e(1) + e(0))     for longer ones.

Outside of the measured range (deeper, steeper, nearer together, further apart, more contacts) the
terms go on growing and count BEYOND times. Those of friction grow with its coefficient, also beyond
the greatest that was measured: a tip that sticks cannot be held better. On another sensor instance
the field is off by more: its own single contacts are interpolated, and its corrections are those of
the nominal dome.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.contact import Tips
from tactibench_sim.tables import RADIUS_MM

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
FILE = "error_bounds.json"
LEVER_MM = 1.0
"""Length of the pins for which the bound of tips is measured; those of the presets are shorter."""
FRICTION_TERMS = slice(6, None)
"""Which of ``envelope_terms`` are those of friction."""
BEYOND = 2.0
"""Factor outside of the measured range. When the deepest, the nearest or the triple scenes are left
out, the envelope of the others fails by less (a test says so)."""
MISSED_MM = 0.1
"""Where the final field misses the depth of a tip by more than this, the scene is counted."""
_BATCH = 32
"""Scenes whose skin is looked at together: each is looked at under the tips of all of them."""
_OFF_APEX = 1e-6  # rad; nearer contacts differ from one at the apex by rounding alone


@dataclass(frozen=True, eq=False)
class Envelope:
    """Bounds of tips of some radii, and the range in which they were measured.

    Attributes:
        smallest: Least radius, mm.
        largest: Greatest radius, mm; only with ``smallest`` RADIUS_MM is that one included.
        fewest: Least number of contacts.
        base: (T,) mm per unit of ``envelope_terms``, of the bases of pins.
        tip: (T,) likewise of the tips of pins of LEVER_MM.
        deepest: Greatest penetration, mm.
        nearest: Least angle between two contacts, rad.
        farthest: Greatest angle between two contacts, rad.
        lowest: Greatest angle of a contact from the apex, rad.
        most: Greatest number of contacts.
    """

    smallest: float
    largest: float
    fewest: int
    base: Array
    tip: Array
    deepest: float
    nearest: float
    farthest: float
    lowest: float
    most: int

    def covers(self, tips: Tips) -> Flags:
        """Return (S,) flags: whether scenes have the radius and the contacts."""
        inside = (tips.radius >= self.smallest) & (tips.radius <= self.largest)
        inside &= (tips.radius == RADIUS_MM) == (self.smallest == self.largest)
        return np.asarray(inside & ((tips.directions()[1] > 0).sum(axis=1) >= self.fewest))

    def bound(self, tips: Tips, length: float) -> Array:
        """Return the (S,) bounds of pin tips, mm.

        Args:
            tips: S scenes.
            length: Length of the pins, mm.
        """
        terms = envelope_terms(tips)
        base, tip, share = terms @ self.base, terms @ self.tip, length / LEVER_MM
        tip = np.maximum(tip, base)  # the two were fitted apart
        out = base + min(share, 1.0) * (tip - base) + max(share - 1.0, 0.0) * (tip + base)
        return np.asarray(np.where(self._measured(tips), out, BEYOND * out))

    def _measured(self, tips: Tips) -> Flags:
        n, delta = tips.directions()
        touching = delta > 0
        polar = np.where(touching, np.arccos(n[..., 2].clip(-1.0, 1.0)), 0.0)
        inside = (delta.max(axis=1) <= self.deepest) & (polar.max(axis=1) <= self.lowest)
        if self.fewest == 1:  # of the deepest tip alone: where others are does not matter
            return np.asarray(inside)
        inside &= touching.sum(axis=1) <= self.most
        for i, j in combinations(range(delta.shape[1]), 2):
            angle = angle_between(n[:, i], n[:, j])
            apart = (angle >= self.nearest) & (angle <= self.farthest)
            inside &= apart | ~(touching[:, i] & touching[:, j])
        return np.asarray(inside)


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds of all tips.

    Attributes:
        envelopes: Envelopes; of two that cover a scene the larger bound counts.
        instance: (2,) mm per mm of the greatest penetration, by which bases and tips of pins of
            LEVER_MM may be further off on another sensor instance.
    """

    envelopes: tuple[Envelope, ...]
    instance: Array

    def bound(self, tips: Tips, length: float, *, instance: bool = False) -> Array:
        """Return how far a pin tip of each scene may be from finite elements.

        Args:
            tips: S scenes.
            length: Length of the pins, mm.
            instance: Whether another instance than the nominal sensor is pressed.

        Returns:
            (S,) bounds, mm; 0 where nothing touches, inf for a radius without an envelope.
        """
        depth = tips.directions()[1].max(axis=1).clip(0.0)
        out = np.where(depth > 0, -np.inf, 0.0)
        for envelope in self.envelopes:
            rows = np.flatnonzero(envelope.covers(tips))
            out[rows] = np.maximum(out[rows], envelope.bound(tips.take(rows), length))
        out[out < 0] = np.inf
        if instance:
            base, tip = self.instance
            out += depth * (base + length / LEVER_MM * max(tip - base, 0.0))
        return out


def angle_between(one: Array, other: Array) -> Array:
    """Return the (S,) angles, rad, between unit vectors (S, 3)."""
    out: Array = np.arccos(np.clip((one * other).sum(axis=-1), -1.0, 1.0))
    return out


def envelope_terms(tips: Tips) -> Array:
    """Return the (S, T) terms that the coefficients of ``Envelope`` multiply; none is negative.

    With d_1 and d_2 the two greatest penetrations, d that of a contact and b its angle from the
    apex, d >= d' those of a pair and m the angle of the pair's middle from the apex, they are

        sqrt d_1,   d_1,   max d^3 sin(b)^4,   d_2,   d_2^2,   sum over pairs of sin(m)^2 d d',
        sqrt(mu w),   mu w

    with mu the coefficient of friction and w = max d tan(b) the way over the skin. The first two
    are what every field is off by, the third what the rim does to the turn of the normals, the next
    two what contacts do to each other, the sixth what the rim changes in that, the last two what
    friction adds.
    """
    n, delta = tips.directions()
    depth = delta.clip(0.0)
    ordered = np.sort(depth, axis=1)
    second = ordered[:, -2] if depth.shape[1] > 1 else np.zeros(len(depth))
    steep = (depth**3 * (1.0 - n[..., 2] ** 2) ** 2).max(axis=1)
    rim = np.zeros(len(depth))
    for i, j in combinations(range(depth.shape[1]), 2):
        middle = n[:, i] + n[:, j]
        length = np.maximum(np.linalg.norm(middle, axis=1), np.finfo(float).tiny)
        rim += (1.0 - (middle[:, 2] / length) ** 2) * depth[:, i] * depth[:, j]
    deepest = ordered[:, -1]
    smooth = [np.sqrt(deepest), deepest, steep, second, second**2, rim]
    slope = np.hypot(n[..., 0], n[..., 1]) / np.maximum(n[..., 2], np.finfo(float).tiny)
    way = (depth * slope).max(axis=1)
    rub = way * (0.0 if tips.friction is None else tips.friction)
    return np.stack([*smooth, np.sqrt(rub), rub], axis=1)


def missed_depths(mechanics: Any, tips: Tips) -> Array:
    """Return by how much the final field misses the depth of a tip of each scene, mm, at most.

    The loads are such that every tip reaches its depth before pairs are corrected and skin is
    dragged. Under the tip's middle the outer skin should lie on the tip. It may lie below a tip
    that carries nothing.

    Args:
        mechanics: ``TableMechanics`` or ``FrictionMechanics``.
        tips: S scenes.
    """
    out = np.zeros(len(tips))
    for first in range(0, len(tips), _BATCH):
        rows = np.arange(first, min(first + _BATCH, len(tips)))
        some = tips.take(rows)
        loads = mechanics.loads(some)
        n, delta = some.directions()
        u = mechanics.outer(loads, n.reshape(-1, 3)).reshape(len(rows), *n.shape)
        place = DOME_RADIUS_MM * n + u[np.arange(len(rows)), np.arange(len(rows))]
        radius = some.radius[:, None]
        sphere = np.isfinite(radius)
        centre = (DOME_RADIUS_MM + np.where(sphere, radius, 0.0) - delta.clip(0.0))[..., None] * n
        round_gap = np.linalg.norm(place - centre, axis=-1) - radius
        gap = np.where(sphere, round_gap, ((place - centre) * n).sum(axis=-1))
        carried = mechanics.forces(loads) > 0
        miss = np.where(carried, abs(gap), -gap)
        out[rows] = np.where(delta > 0, miss, 0.0).max(axis=1).clip(0.0)
    return out


def term_counts(tier: str, tips: Tips) -> dict[str, int]:
    """Return how many of S scenes use each term of the field; terms of no scene are left out."""
    n, delta = tips.directions()
    touching = delta > 0
    count = touching.sum(axis=1)
    off = touching & (np.hypot(n[..., 0], n[..., 1]) > _OFF_APEX)
    counts = {"untouched": count == 0, "single": count == 1}
    if tier == "coupled":
        counts |= {"pair": count == 2, "three or more": count > 2}
    else:
        counts["added up"] = count > 1
    counts["rim"] = off.any(axis=1)
    return {name: int(rows.sum()) for name, rows in counts.items() if rows.any()}


@cache
def shipped_bounds() -> Bounds:
    """Return the bounds of the tables that ship."""
    return bounds_from_json((resources.files(__package__) / "data" / FILE).read_text("utf-8"))


def bounds_from_json(text: str) -> Bounds:
    """Read a file of bounds."""
    content = json.loads(text)
    envelopes = tuple(_envelope(values) for values in content["envelopes"])
    return Bounds(envelopes, np.array(content["instance"]))


def _envelope(values: dict[str, Any]) -> Envelope:
    return Envelope(**{**values, **{name: np.array(values[name]) for name in ("base", "tip")}})
