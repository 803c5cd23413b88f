"""Make the file of plate tables that the comparison uses (minutes of finite elements a dome)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim import sealed
from tactibench_sim.fem import Dome, press
from tactibench_sim.real.drag import drag
from tactibench_sim.tabulate import normal_rotation

Array = npt.NDArray[np.float64]

DEEPEST_MM, STEP_MM, POLAR_STEP_DEG = 6.25, 0.25, 1.0
PATCHES_DEG = (4.0, 8.0, 12.0, 16.0, 20.0, 25.0, 30.0, 36.0, 42.0, 50.0)
_CLEAR_MM = 0.03  # a point of the skin this close under the plate counts as touching


def make(path: Path, kinds: Sequence[tuple[float, str]]) -> str:
    """Write tables of plates on domes of (stiffness ratio, friction "none" or "stick").

    Returns the file's digest. Raises UserError without NGSolve, fem.NotConvergedError where a run
    fails.
    """
    depths = np.arange(round(DEEPEST_MM / STEP_MM) + 1) * STEP_MM
    delta = np.asarray(depths, dtype=np.float64)
    degrees = np.arange(round(90 / POLAR_STEP_DEG) + 1) * POLAR_STEP_DEG
    polar = np.asarray(np.radians(degrees), dtype=np.float64)
    arrays: dict[str, Any] = {}
    for ratio, friction in kinds:
        dome = Dome(stiffness_ratio=ratio, apex_size=0.15)
        profiles = list(press(dome, math.inf, delta, polar, friction=friction))
        w, t = np.stack([p.inner for p in profiles], axis=1)
        outer = np.stack([p.outer for p in profiles], axis=1)
        name = f"{ratio:g}_{friction}"
        fields = np.stack([w, t, normal_rotation(dome.inner, polar, w, t)], axis=-1)
        arrays[f"{name}_press"] = fields.astype(np.float32)
        arrays[f"{name}_patch"] = _patch(dome.outer, delta, polar, outer).astype(np.float32)
        coarse = Dome(stiffness_ratio=ratio, apex_size=0.3, skin_size=0.4)
        arrays[f"{name}_drag"] = drag(coarse, np.radians(PATCHES_DEG), polar).astype(np.float32)
    arrays |= {"delta": delta, "polar": polar, "patches": np.radians(PATCHES_DEG)}
    return sealed.write(path, arrays, {"kinds": [f"{r:g}_{friction}" for r, friction in kinds]})


def _patch(radius: float, delta: Array, polar: Array, outer: Array) -> Array:
    """(D,) angular radius of the part of the skin that touches the plate, rad."""
    height = (radius - outer[0]) * np.cos(polar) - outer[1] * np.sin(polar)
    touching = height >= radius - delta[:, None] - _CLEAR_MM
    reach = np.where(touching, polar, 0.0).max(axis=1)
    reach[delta == 0] = 0.0
    return np.asarray(reach, dtype=np.float64)
