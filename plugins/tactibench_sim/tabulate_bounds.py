"""Measure the error bounds of the tiers: what the tables say against the reference scenes.

Errors of ``coupled`` are the largest over the pins of every scene. The error of ``superpose`` for a
pair is, by the triangle inequality, no larger than the largest difference of the two tiers and the
largest error of ``coupled`` for pairs of that penetration together.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.bounds import Bounds
from tactibench_sim.contact import Tips
from tactibench_sim.corrections import Chart
from tactibench_sim.dome_kernels import Array
from tactibench_sim.field import Mechanics
from tactibench_sim.reference import RADIUS_MM, ReferenceScene
from tactibench_sim.table import Tables

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
    coupled, superposed = Mechanics(tables, "coupled"), Mechanics(tables, "superpose")
    judged = np.array([_judged(coupled, scene) for scene in scenes])
    count, deepest, polar, errors = judged.T
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
    """(D,) largest error of all scenes up to each depth node, never falling."""
    return np.array([errors[deepest <= node + _CLOSE].max(initial=0.0) for node in nodes])


def reached(nodes: Sequence[float], deepest: Array) -> Flags:
    """(D,) is there a scene as deep as a node, or at least nearer to it than to the one before?"""
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


def _judged(coupled: Mechanics, scene: ReferenceScene) -> tuple[float, float, float, float]:
    """How many contacts, the deepest and the lowest of them (mm, rad), and the error, mm."""
    loads = coupled.loads(scene.asked)
    touching = loads.delta[0] > 0
    off = coupled.displacement(loads, scene.directions)[0][0] - scene.displacement
    lowest = math.acos(min(1.0, loads.n[0, touching, 2].min()))
    return touching.sum(), loads.delta.max(), lowest, np.linalg.norm(off, axis=1).max()


def _singles(rings: Array, polar: Array, deepest: Array, errors: Array) -> Array:
    """(B, D) errors up to a polar angle, where scenes between it and the one before are so deep."""
    rows = []
    for above, below in pairwise([-1.0, *rings]):
        inside = polar <= below + _CLOSE
        known = reached(DEPTH_MM, deepest[inside & (polar > above + _CLOSE)])
        largest = envelope(DEPTH_MM, deepest[inside], errors[inside])
        rows.append(np.where(known, largest, np.inf))
    return np.stack(rows)


def _at_one_place() -> Array:
    """(D', D') two contacts at one place are the deeper one: adding counts the other too."""
    return np.minimum.outer(ADDED_DEPTH_MM, ADDED_DEPTH_MM)


def _added(coupled: Mechanics, superposed: Mechanics, angle: float) -> Array:
    """(D', D') largest difference of the tiers for two contacts that far apart, rad."""
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
    """(D', D') error of ``coupled`` for pairs of two penetrations; 0 where one does not touch."""
    deeper = np.maximum.outer(ADDED_DEPTH_MM, ADDED_DEPTH_MM)
    error = pair[np.searchsorted(DEPTH_MM, deeper - _CLOSE)]
    return np.where(_at_one_place() > 0, error, 0.0)
