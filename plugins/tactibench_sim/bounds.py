"""Measured error bounds of the tiers, against three-dimensional finite elements.

* a single contact: the largest error of the tables by polar angle and penetration;
* ``superpose``: that, and for every pair the largest error of adding up its two contacts, by the
  angle between them and both penetrations; and what more than two contacts do beyond their pairs;
* ``coupled``: the largest error over the reference scenes by the deepest penetration, for two
  contacts and for more.

They were measured for one table file and are unknown for any other.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from tactibench_sim.dome_kernels import Array

FILE = "bounds.json"
BETWEEN = 1.5
"""Errors of superposing bulge upwards between the nodes; this times the linear value holds them
(tested on every reference scene)."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds in mm, by penetration; beyond the last node they are unknown (inf).

    depth: (D,) nodes, mm. single: (B, D) for one contact up to the polar angles ``polar`` (B,),
    rad. pair, many: (D,) for two and more contacts in tier ``coupled``. angle: (A,) rad, added:
    (A, D', D') errors of superposing a pair at penetrations ``added_depth``; the nearest angle
    stands for those outside.
    """

    depth: Array
    polar: Array
    single: Array
    pair: Array
    many: Array
    angle: Array
    added_depth: Array
    added: Array

    def by_depth(self, values: Array, deepest: Array) -> Array:
        """(S,) the bound up to the next depth node; 0 at 0."""
        known = np.append(values, np.inf)
        out: Array = known[np.searchsorted(self.depth, deepest - 1e-9)]
        return np.where(deepest > 0, out, 0.0)

    def alone(self, polar: Array, deepest: Array) -> Array:
        """(S,) bound of single contacts up to a polar angle, rad, and a penetration."""
        row = np.searchsorted(self.polar, polar - 1e-9)
        out = np.full(np.shape(deepest), np.inf)
        for k in range(len(self.polar)):
            out = np.where(row == k, self.by_depth(self.single[k], deepest), out)
        return out

    def superposing(self, angle: Array, first: Array, second: Array) -> Array:
        """What adding up a pair leaves out, mm; all of one shape."""
        nodes = self.angle, self.added_depth, self.added_depth
        table = RegularGridInterpolator(nodes, self.added)
        last = self.added_depth[-1]
        inside = [
            np.clip(angle, self.angle[0], self.angle[-1]),
            np.clip(first, 0.0, last),
            np.clip(second, 0.0, last),
        ]
        out: Array = BETWEEN * table(np.stack(inside, axis=-1))
        return np.where(np.maximum(first, second) > last, np.inf, out)


@cache
def _shipped() -> Mapping[str, Any]:
    told: Mapping[str, Any] = json.loads(files(__package__).joinpath(FILE).read_text())
    return told


def bounds_for(digest: str) -> Bounds | None:
    """Those measured for the table file with that digest; None where nobody measured them."""
    told = _shipped()
    if told["tables"] != digest:
        return None
    return Bounds(**{f.name: np.asarray(told[f.name], dtype=np.float64) for f in fields(Bounds)})


def envelope(nodes: Sequence[float], deepest: Array, errors: Array) -> list[float]:
    """Largest error of all scenes up to each depth node (and a little beyond), never falling."""
    return [float(errors[deepest <= node + 1e-9].max(initial=0.0)) for node in nodes]


def measured(
    digest: str,
    nodes: Sequence[float],
    polar: Sequence[float],
    scenes: Mapping[str, tuple[Array, Array, Array]],
    angle: Array,
    added_depth: Array,
    added: Callable[[int, float, float], float],
) -> dict[str, Any]:
    """JSON values of bounds, for polar angles in rad.

    scenes: "single", "pair", "many" -> (deepest mm, error mm, polar angle rad), each (N,).

    added: error of superposing at angle number k and two penetrations; 0 where one is 0.
    """
    table = [[[float(min(a, b)) for b in added_depth] for a in added_depth]]  # at one place
    table += [
        [[0.0 if min(a, b) == 0 else added(k, a, b) for b in added_depth] for a in added_depth]
        for k in range(len(angle))
    ]
    deepest, errors, angles = scenes["single"]
    single = [
        envelope(nodes, deepest[angles <= up_to + 1e-9], errors[angles <= up_to + 1e-9])
        for up_to in polar
    ]
    kinds = {kind: envelope(nodes, *scenes[kind][:2]) for kind in ("pair", "many")}
    return {
        "tables": digest,
        "depth": list(nodes),
        "polar": list(polar),
        "single": single,
        **kinds,
        "angle": [0.0, *(float(a) for a in angle)],
        "added_depth": [float(d) for d in added_depth],
        "added": table,
    }
