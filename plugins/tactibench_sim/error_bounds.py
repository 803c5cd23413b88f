"""Measured error bounds of tier ``coupled``: how far a scene may be from finite elements.

The file that ships holds what scripts/fem/error_bounds.py measured on the reference scenes with
the tables that ship, on the nominal dome: tips of R = 3 mm, and singles and pairs of sharper and of
blunter ones. Nothing is known of other tables or tiers, nor of scenes outside of what was measured;
the bound is infinite there.

A single contact has the largest error of the reference scenes up to its depth and polar angle. For
two and more contacts the bound is an *envelope*

    f (c_1 d_1 + c_2 d_2 + c_3 d_2^2 + c_4 sum over pairs of sin(beta)^2 d^2 d'),

with d_1 and d_2 the two greatest penetrations, d >= d' those of a pair and beta the angle between
the apex and the middle of the pair. The first term is what every field is off by, the next two what
contacts do to each other, the last what the rim changes in that, which the tables do not hold. The
coefficients are the smallest that hold every reference scene. The factor f makes it hold on runs
that were left out when the coefficients were found. Other radii than 3 mm have envelopes of their
own: of a single contact, where the first term alone is left, and of a pair.
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

from tactibench_sim.contact import Tips
from tactibench_sim.tables import shipped_file

Array = npt.NDArray[np.float64]
FILE = "error_bounds.json"
RADIUS_MM = 3.0
"""Radius of the tips of the nominal reference scenes; ``OtherTips`` holds bounds for others."""
_ON_NODE = 1e-9  # a value that rounding put this little above a node still is on it
_OFF_APEX = 1e-6  # rad; nearer contacts differ from one at the apex by rounding alone


@dataclass(frozen=True, eq=False)
class Envelope:
    """Bound of scenes with several contacts, and the range in which it was measured.

    Attributes:
        coefficients: (4,) mm per unit of ``envelope_terms``.
        factor: Factor on all terms.
        deepest: Greatest penetration, mm.
        nearest: Least angle between two contacts, rad.
        farthest: Greatest angle between two contacts, rad.
        lowest: Greatest angle of a contact from the apex, rad.
    """

    coefficients: Array
    factor: float
    deepest: float
    nearest: float
    farthest: float
    lowest: float

    def bound(self, n: Array, depth: Array) -> Array:
        """Return the (S,) bounds of S scenes, mm; inf outside of the range.

        Args:
            n: (S, K, 3) directions of the tips.
            depth: (S, K) penetrations, mm; 0: no contact.
        """
        out: Array = self.factor * (envelope_terms(n, depth) @ self.coefficients)
        touching = depth > 0
        polar = np.where(touching, np.arccos(np.clip(n[..., 2], -1.0, 1.0)), 0.0)
        inside = (depth.max(axis=1) <= self.deepest) & (polar.max(axis=1) <= self.lowest)
        for i, j in combinations(range(depth.shape[1]), 2):
            angle = angle_between(n[:, i], n[:, j])
            apart = (angle >= self.nearest) & (angle <= self.farthest)
            inside &= apart | ~(touching[:, i] & touching[:, j])
        return np.where(inside, out, np.inf)


@dataclass(frozen=True, eq=False)
class OtherTips:
    """Bounds of single contacts and pairs of tips whose radius is not RADIUS_MM.

    Attributes:
        smallest: Least radius, mm.
        largest: Greatest radius, mm.
        single: Bound of a single contact.
        pair: Bound of a pair.
    """

    smallest: float
    largest: float
    single: Envelope
    pair: Envelope

    def bound(self, n: Array, delta: Array) -> Array:
        """Return the (S,) bounds of S scenes, mm; inf where they are unknown.

        Args:
            n: (S, K, 3) directions of the tips.
            delta: (S, K) penetrations, mm.
        """
        depth = np.maximum(delta, 0.0)
        count = (depth > 0).sum(axis=1)
        first = depth.argmax(axis=1)[:, None]
        alone = np.take_along_axis(n, first[..., None], 1), np.take_along_axis(depth, first, 1)
        out = self.single.bound(*alone)
        # Two contacts are not taken to be more exact than the deeper of them alone.
        out = np.where(count > 1, np.maximum(out, self.pair.bound(n, depth)), out)
        return np.where(count > 2, np.inf, out)


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds in mm; inf where they are unknown, as beyond the last node.

    Attributes:
        depth: (D,) nodes of the penetration, mm.
        polar: (B,) nodes of the polar angle, rad.
        single: (B, D) bounds of one contact up to each polar angle and penetration.
        pair: Bound of two contacts.
        many: Bound of more than two contacts.
        others: Bounds of tips of other radii.
    """

    depth: Array
    polar: Array
    single: Array
    pair: Envelope
    many: Envelope
    others: tuple[OtherTips, ...] = ()

    def alone(self, polar: Array, deepest: Array) -> Array:
        """Return the (S,) bounds of single contacts, mm.

        Args:
            polar: (S,) polar angles, rad.
            deepest: (S,) penetrations, mm.
        """
        padded = np.pad(self.single, ((0, 1), (0, 1)), constant_values=np.inf)
        row = np.searchsorted(self.polar, polar - _ON_NODE)
        out: Array = padded[row, np.searchsorted(self.depth, deepest - _ON_NODE)]
        return np.where(deepest > 0, out, 0.0)

    def nominal(self, n: Array, delta: Array) -> Array:
        """Return the (S,) bounds of scenes, mm.

        Args:
            n: (S, K, 3) directions of tips of RADIUS_MM.
            delta: (S, K) penetrations, mm.
        """
        depth = np.maximum(delta, 0.0)
        count = (depth > 0).sum(axis=1)
        polar = np.arccos(np.clip(np.where(depth > 0, n[..., 2], 1.0), -1.0, 1.0))
        bound = self.alone(polar.max(axis=1), depth.max(axis=1))
        for rows, envelope in ((count == 2, self.pair), (count > 2, self.many)):
            if rows.any():
                # Several contacts are not taken to be more exact than the deepest of them alone.
                bound[rows] = np.maximum(bound[rows], envelope.bound(n[rows], depth[rows]))
        return bound


def angle_between(one: Array, other: Array) -> Array:
    """Return the (S,) angles, rad, between unit vectors (S, 3)."""
    out: Array = np.arccos(np.clip((one * other).sum(axis=-1), -1.0, 1.0))
    return out


def envelope_terms(n: Array, depth: Array) -> Array:
    """Return the (S, 4) terms that the coefficients of ``Envelope`` multiply.

    Args:
        n: (S, K, 3) directions of the tips.
        depth: (S, K) penetrations, mm; 0: no contact.
    """
    ordered = np.sort(depth, axis=1)
    second = ordered[:, -2] if depth.shape[1] > 1 else np.zeros(len(depth))
    out = np.stack([ordered[:, -1], second, second**2, np.zeros(len(depth))], axis=1)
    for i, j in combinations(range(depth.shape[1]), 2):
        middle = n[:, i] + n[:, j]
        length = np.maximum(np.linalg.norm(middle, axis=1), np.finfo(float).tiny)
        sine_squared = 1.0 - (middle[:, 2] / length) ** 2
        larger, smaller = np.maximum(depth[:, i], depth[:, j]), np.minimum(depth[:, i], depth[:, j])
        out[:, 3] += sine_squared * larger**2 * smaller
    return out


def scene_bounds(tier: str, digest: str, tips: Tips) -> Array:
    """Return how far a pin base of each scene may be from finite elements.

    Args:
        tier: Tier of the mechanics; only "coupled" was measured.
        digest: Digest of the tables; only those that ship were measured.
        tips: Tips of S scenes.

    Returns:
        (S,) bounds, mm; inf where they are not known.
    """
    tables_digest, tips_digest, bounds = shipped_bounds()
    n, delta = tips.directions()
    out = np.full(len(tips), np.inf)
    if tier == "coupled" and digest == tables_digest:
        rows = tips.radius == RADIUS_MM
        if rows.any():
            out[rows] = bounds.nominal(n[rows], delta[rows])
        for other in bounds.others:
            rows = (tips.radius >= other.smallest) & (tips.radius <= other.largest)
            rows &= tips.radius != RADIUS_MM
            if rows.any() and shipped_file("tips.npz").digest == tips_digest:
                out[rows] = other.bound(n[rows], delta[rows])
    out[(delta <= 0).all(axis=1)] = 0.0  # nothing touches: the rest frame
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
def shipped_bounds() -> tuple[str, str, Bounds]:
    """Return the digests of the tables and of the tables of other tips, and the bounds of both."""
    return bounds_from_json((resources.files(__package__) / "data" / FILE).read_text("utf-8"))


def bounds_from_json(text: str) -> tuple[str, str, Bounds]:
    """Read a file of bounds: the digests of the two tables that they are for, and the bounds."""
    content = json.loads(text)
    bounds = Bounds(
        depth=_array(content["depth"]),
        polar=_array(content["polar"]),
        single=_array(content["single"]),
        pair=_envelope(content["pair"]),
        many=_envelope(content["many"]),
        others=tuple(_other_tips(values) for values in content["others"]),
    )
    return content["tables"], content["tips"], bounds


def _other_tips(values: dict[str, Any]) -> OtherTips:
    envelopes = {name: _envelope(values[name]) for name in ("single", "pair")}
    return OtherTips(values["smallest"], values["largest"], **envelopes)


def _envelope(values: dict[str, Any]) -> Envelope:
    return Envelope(**{**values, "coefficients": _array(values["coefficients"])})


def _array(values: Any) -> Array:
    """Return an array; null stands for infinity, which JSON does not have."""
    array = np.asarray(values, dtype=np.float64)
    return np.where(np.isnan(array), np.inf, array)
