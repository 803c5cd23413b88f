"""Measured error bounds of the tiers, against the finite-element scenes that ship.

    PYTHONPATH=.:plugins python scripts/fem/error_bounds.py scripts/fem/error_bounds.json

Seconds. No tier chooses by them today; they say how far a scene may be from finite elements:

* a single contact: the largest error of the tables by polar angle and penetration;
* ``superpose``: that, and for every pair the largest error of adding up its two contacts, by the
  angle between them and both penetrations; and what more than two contacts do beyond their pairs;
* ``coupled``: the largest error over the reference scenes by the deepest penetration, for two
  contacts and for more.

The error of ``superpose`` for a pair is, by the triangle inequality, no larger than the largest
difference of the two tiers and the largest error of ``coupled`` for pairs of that penetration
together. Bounds are measured for one table file and unknown for any other.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from fem_script import output_file, write_file
from modes import Chart
from scipy.interpolate import RegularGridInterpolator

from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.mechanics import tables
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.mechanics.kernels import Array
from tactibench_sim.mechanics.tables import Tables
from tactibench_sim.reference_frames import scenes as reference
from tactibench_sim.reference_frames.scenes import RADIUS_MM, ReferenceScene

FILE = Path(__file__).with_suffix(".json")
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
        """Return (S,) the bound up to the next depth node; 0 at 0."""
        known = np.append(values, np.inf)
        out: Array = known[np.searchsorted(self.depth, deepest - 1e-9)]
        return np.where(deepest > 0, out, 0.0)

    def alone(self, polar: Array, deepest: Array) -> Array:
        """Return the (S,) bound of single contacts up to a polar angle, rad, and a penetration."""
        row = np.searchsorted(self.polar, polar - 1e-9)
        out = np.full(np.shape(deepest), np.inf)
        for k in range(len(self.polar)):
            out = np.where(row == k, self.by_depth(self.single[k], deepest), out)
        return out

    def superposing(self, angle: Array, first: Array, second: Array) -> Array:
        """Return the error of adding up a pair, mm; all of one shape."""
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

    def of_scenes(self, n: Array, delta: Array) -> tuple[Array, Array]:
        """Return (S,) bounds of ``superpose`` and of ``coupled``, mm.

        n: (S, K, 3) directions and delta: (S, K) penetrations of tips of RADIUS_MM.
        """
        depth = np.maximum(delta, 0.0)
        deepest, count = depth.max(axis=1), (depth > 0).sum(axis=1)
        lowest = np.where(depth > 0, n[..., 2], 1.0).min(axis=1)
        single = self.alone(np.arccos(np.clip(lowest, -1.0, 1.0)), deepest)
        superposed = single.copy()
        for i in range(delta.shape[1]):
            for j in range(i + 1, delta.shape[1]):
                rows = np.flatnonzero((depth[:, i] > 0) & (depth[:, j] > 0))
                if len(rows):
                    cosine = np.clip((n[rows, i] * n[rows, j]).sum(axis=1), -1.0, 1.0)
                    superposed[rows] += self.superposing(
                        np.arccos(cosine), depth[rows, i], depth[rows, j]
                    )
        many = self.by_depth(self.many, deepest)
        superposed = np.where(count > 2, superposed + many, superposed)
        pair = self.by_depth(self.pair, deepest)
        return superposed, np.select([count < 2, count == 2], [single, pair], many)


def read(path: Path = FILE) -> tuple[str, Bounds]:
    """Read a file of bounds: the digest of the tables that they are for, and the bounds."""
    content = json.loads(path.read_text())
    bounds = Bounds(**{field.name: _array(content[field.name]) for field in fields(Bounds)})
    return content["tables"], bounds


def _array(values: Any) -> Array:
    """Return an array; JSON has no infinity, so that null stands for it."""
    array = np.asarray(values, dtype=np.float64)
    return np.where(np.isnan(array), np.inf, array)


DEPTH_MM = (1.0, 2.0, 3.0, 4.5, 6.0, 6.5)
POLAR_DEG = (20.0, 40.0, 55.0)
ANGLE_DEG = (9.0, 14.0, 18.5, 24.0, 31.0, 40.0)
ADDED_DEPTH_MM = (0.0, 0.75, 1.75, 3.0, 4.5, 6.0)
CHART = Chart(start=-75.0, reach=75.0, across=75.0, step=2.5)
"""Where the two tiers are compared, around the middle of a pair; it is symmetric."""
_STEP_MM = 1e-4  # bounds are written rounded up to it
_CLOSE = 1e-6  # by which scenes may be off the node they were made for

Flags = npt.NDArray[np.bool_]


def measured(tables: Tables, scenes: Sequence[ReferenceScene]) -> Bounds:
    """Bounds of the tiers with those tables, for the indenter of the scenes."""
    coupled, superposed = TableMechanics(tables, "coupled"), TableMechanics(tables, "superpose")
    table = np.array([_scene_error(coupled, scene) for scene in scenes])
    count, deepest, polar, errors = table.T
    pair, many = (
        np.where(
            reached(DEPTH_MM, deepest[rows]),
            envelope(DEPTH_MM, deepest[rows], errors[rows]),
            np.inf,
        )
        for rows in (count == 2, count > 2)
    )
    alone = count == 1
    rings = np.radians(POLAR_DEG)
    added = np.stack([_added(coupled, superposed, math.radians(angle)) for angle in ANGLE_DEG])
    return Bounds(
        depth=np.array(DEPTH_MM),
        polar=rings,
        single=_singles(rings, polar[alone], deepest[alone], errors[alone]),
        pair=pair,
        many=many,
        angle=np.append(0.0, np.radians(ANGLE_DEG)),
        added_depth=np.array(ADDED_DEPTH_MM),
        added=np.concatenate([_at_one_place()[None], added + _left_over(pair)]),
    )


def envelope(nodes: Sequence[float], deepest: Array, errors: Array) -> Array:
    """Return (D,) largest error of all scenes up to each depth node, never falling."""
    return np.array([errors[deepest <= node + _CLOSE].max(initial=0.0) for node in nodes])


def reached(nodes: Sequence[float], deepest: Array) -> Flags:
    """Return (D,) True where a scene is as deep as a node, or nearer to it than to the last."""
    middle = np.array([(a + b) / 2 for a, b in pairwise([0.0, *nodes])])
    return np.asarray(middle <= deepest.max(initial=0.0))


def write(path: Path, tables: Tables, bounds: Bounds) -> str:
    """Write bounds as JSON, rounded up, null for infinity. Returns the sha256 of the file."""
    content: dict[str, Any] = {"tables": tables.digest}
    content |= {f.name: _rounded(getattr(bounds, f.name)) for f in fields(Bounds)}
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text)
    temporary.replace(path)
    return hashlib.sha256(text.encode()).hexdigest()


def _rounded(values: Array) -> Any:
    if values.ndim:
        return [_rounded(one) for one in values]
    if math.isinf(values):
        return None
    return round(math.ceil(float(values) / _STEP_MM - _CLOSE) * _STEP_MM, 4)


def _scene_error(
    coupled: TableMechanics, scene: ReferenceScene
) -> tuple[float, float, float, float]:
    """Return the number of contacts, the deepest and the lowest (mm, rad), and the error, mm."""
    loads = coupled.loads(scene.as_tips)
    touching = loads.delta[0] > 0
    off = coupled.displacement(loads, scene.directions)[0][0] - scene.displacement
    lowest = math.acos(min(1.0, loads.n[0, touching, 2].min()))
    return touching.sum(), loads.delta.max(), lowest, np.linalg.norm(off, axis=1).max()


def _singles(rings: Array, polar: Array, deepest: Array, errors: Array) -> Array:
    """Return (B, D) errors up to a polar angle, where scenes between it and the last reach."""
    rows = []
    for above, below in pairwise([-1.0, *rings]):
        inside = polar <= below + _CLOSE
        known = reached(DEPTH_MM, deepest[inside & (polar > above + _CLOSE)])
        largest = envelope(DEPTH_MM, deepest[inside], errors[inside])
        rows.append(np.where(known, largest, np.inf))
    return np.stack(rows)


def _at_one_place() -> Array:
    """Return (D', D'): two contacts at one place are the deeper one; adding counts both."""
    return np.minimum.outer(ADDED_DEPTH_MM, ADDED_DEPTH_MM)


def _added(coupled: TableMechanics, superposed: TableMechanics, angle: float) -> Array:
    """Return the (D', D') largest difference of the tiers for two contacts so far apart."""
    depths = np.stack(np.meshgrid(ADDED_DEPTH_MM, ADDED_DEPTH_MM, indexing="ij"), axis=-1)
    half, reach = angle / 2, DOME_RADIUS_MM + RADIUS_MM
    n = np.array([[-math.sin(half), 0.0, math.cos(half)], [math.sin(half), 0.0, math.cos(half)]])
    centres = (reach - depths.reshape(-1, 2))[..., None] * n
    height = np.sqrt(reach**2 - (centres[..., :2] ** 2).sum(axis=-1))
    tips = Tips(centres[..., :2], height - centres[..., 2], np.full(len(centres), RADIUS_MM))
    at = CHART.directions().reshape(-1, 3)
    one, other = (tier.displacement(tier.loads(tips), at)[0] for tier in (coupled, superposed))
    largest: Array = np.linalg.norm(one - other, axis=-1).max(axis=-1)
    return np.where(depths.min(axis=-1) > 0, largest.reshape(depths.shape[:2]), 0.0)


def _left_over(pair: Array) -> Array:
    """Return the (D', D') error of ``coupled`` for pairs; 0 where one does not touch."""
    deeper = np.maximum.outer(ADDED_DEPTH_MM, ADDED_DEPTH_MM)
    error = pair[np.searchsorted(DEPTH_MM, deeper - _CLOSE)]
    return np.where(_at_one_place() > 0, error, 0.0)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Measure the error bounds of the tiers.")
    parser.add_argument("out", type=output_file)
    given = parser.parse_args()
    shipped = tables.shipped()
    write_file(given.out, lambda: write(given.out, shipped, measured(shipped, reference.shipped())))


if __name__ == "__main__":
    main()
