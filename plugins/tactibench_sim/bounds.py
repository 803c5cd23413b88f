"""Measured error bounds of the tiers, against three-dimensional finite elements.

* a single contact: the largest error of the tables by polar angle and penetration;
* ``superpose``: that, and for every pair the largest error of adding up its two contacts, by the
  angle between them and both penetrations; and what more than two contacts do beyond their pairs;
* ``coupled``: the largest error over the reference scenes by the deepest penetration, for two
  contacts and for more.

They were measured for one table file (see ``tabulate_bounds``) and are unknown for any other.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
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
    """Bounds in mm, by penetration; inf where they are unknown, as beyond the last node.

    depth: (D,) nodes, mm. single: (B, D) for one contact up to the polar angles ``polar`` (B,),
    rad. pair, many: (D,) for two and more contacts in tier ``coupled``. angle: (A,) rad, added:
    (A, D', D') errors of superposing a pair at penetrations ``added_depth``, all finite; the
    nearest angle stands for those outside.
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
    return Bounds(**{f.name: _read(told[f.name]) for f in fields(Bounds)})


def _read(values: Any) -> Array:
    """JSON has no infinity: null stands for it."""
    found = np.asarray(values, dtype=np.float64)
    return np.where(np.isnan(found), np.inf, found)
