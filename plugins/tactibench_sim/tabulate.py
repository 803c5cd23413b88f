"""Make the table file from finite-element runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench_sim import fem, sealed, table

Array = npt.NDArray[np.float64]
DEEPEST_MM, STEP_MM = 6.5, 0.125
POLAR_STEP_DEG = 0.5


def tabulate(
    path: Path,
    dome: fem.Dome,
    radii: Sequence[float] = table.RADII,
    told: Callable[[str], None] = lambda _: None,
    runs: Path | None = None,
) -> str:
    """Press spheres of ``radii`` mm (inf: a plate), write the file and return its digest.

    runs: a folder for three-dimensional runs (see ``snapshots``), those that are missing there are
    made, which takes an hour; from them the file gets corrections for contacts off the apex and for
    pairs. None: a file without corrections.

    Nothing is written unless every run converged. Raises UserError without NGSolve,
    fem.NotConvergedError where a run fails.
    """
    depths = np.arange(round(DEEPEST_MM / STEP_MM) + 1) * STEP_MM
    delta = np.asarray(depths, dtype=np.float64)
    degrees = np.arange(round(90 / POLAR_STEP_DEG) + 1) * POLAR_STEP_DEG
    polar = np.asarray(np.radians(degrees), dtype=np.float64)
    arrays: dict[str, npt.NDArray[Any]] = {"delta": delta, "polar": polar}
    for shape, radius in {table.shape_of(radius): radius for radius in radii}.items():
        told(shape)
        for quantity, values in columns(dome, radius, delta, polar).items():
            arrays[f"{shape}_{quantity}"] = values.astype(np.float32)
    ngsolve = fem.require_ngsolve()
    parameters = {"dome": asdict(dome), "solver": f"ngsolve {ngsolve.__version__}"}
    if runs is not None:
        from tactibench_sim.snapshots import corrected

        arrays, parameters = corrected(arrays, parameters, dome, runs, told)
    return sealed.write(path, arrays, parameters)


def columns(dome: fem.Dome, radius: float, delta: Array, polar: Array) -> dict[str, Array]:
    """The quantities of a table: (D, T) each, force (D,)."""
    profiles = list(fem.press(dome, radius, delta, polar))
    w, t = np.stack([p.inner for p in profiles], axis=1)
    w_outer, t_outer = np.stack([p.outer for p in profiles], axis=1)
    return {
        "w": w,
        "t": t,
        "omega": normal_rotation(dome.inner, polar, w, t),
        "w_outer": w_outer,
        "t_outer": t_outer,
        "force": np.array([p.force for p in profiles]),
    }


def normal_rotation(radius: float, polar: Array, w: Array, t: Array) -> Array:
    """Finite rotation of the normal of a meridian displaced by w (inward) and t, rad.

    The tangent of (r - w) b + t e is (r - w + t') e - (w' + t) b; to first order this is
    (dw/dtheta + t) / r.
    """
    slope_w = CubicSpline(polar, w, axis=-1)(polar, 1)
    slope_t = CubicSpline(polar, t, axis=-1)(polar, 1)
    rotation: Array = np.arctan2(slope_w + t, radius - w + slope_t)
    rotation[..., 0] = 0.0
    return rotation
