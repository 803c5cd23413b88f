"""Make the dome's table file of single-contact fields from finite-element runs.

    PYTHONPATH=.:plugins python scripts/fem/tabulate_dome.py OUT [--radius R ...]

It takes half a minute a radius. --corrections FOLDER adds the corrections for contacts off the apex
and for pairs, from three-dimensional runs that are kept in that folder. They take an hour; the same
command given again goes on where it stopped. Give OUT to a sensor with --param sensor.table=OUT.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from dome_press import press
from fem_script import number, output_file, report_progress, write_file
from scipy.interpolate import CubicSpline

from tactibench_sim import data_file, fem
from tactibench_sim.mechanics.tables import SMALLEST_MM, shape_name

Array = npt.NDArray[np.float64]
RADII = (3.0, math.inf)
"""Indenters of the file that ships, mm; inf: a plate."""
DEEPEST_MM, STEP_MM = 6.5, 0.125
POLAR_STEP_DEG = 0.5


def tabulate(
    path: Path,
    dome: fem.Dome,
    radii: Sequence[float] = RADII,
    progress: Callable[[str], None] = lambda _: None,
    runs: Path | None = None,
) -> str:
    """Press spheres, write the file of their tables and return its digest.

    Nothing is written unless every run converged.

    Args:
        path: File to write.
        dome: Dome that is pressed.
        radii: Radii of the spheres, mm; inf: a plate.
        progress: Function that is told the name of each run before it starts.
        runs: Folder of three-dimensional runs (see ``snapshots``), from which the file gets
            corrections for contacts off the apex and for pairs. Runs that are missing there are
            made, which takes an hour. None: a file without corrections.

    Raises:
        UserError: NGSolve is not installed, or a run in the folder cannot be read or is of another
            dome or mesh.
        fem.NotConvergedError: A run failed.
    """
    depths = np.arange(round(DEEPEST_MM / STEP_MM) + 1) * STEP_MM
    delta = np.asarray(depths, dtype=np.float64)
    degrees = np.arange(round(90 / POLAR_STEP_DEG) + 1) * POLAR_STEP_DEG
    polar = np.asarray(np.radians(degrees), dtype=np.float64)
    arrays: dict[str, npt.NDArray[Any]] = {"delta": delta, "polar": polar}
    for shape, radius in {shape_name(radius): radius for radius in radii}.items():
        progress(shape)
        for quantity, values in columns(dome, radius, delta, polar).items():
            arrays[f"{shape}_{quantity}"] = values.astype(np.float32)
    ngsolve = fem.require_ngsolve()
    parameters = {"dome": asdict(dome), "solver": f"ngsolve {ngsolve.__version__}"}
    if runs is not None:
        from snapshots import with_corrections

        arrays, parameters = with_corrections(arrays, parameters, dome, runs, progress)
    return data_file.write(path, arrays, parameters)


def columns(dome: fem.Dome, radius: float, delta: Array, polar: Array) -> dict[str, Array]:
    """Return the quantities of a table: (D, T) each, mm and rad; force (D,), E_skin mm^2.

    Args:
        dome: Dome that is pressed on its apex.
        radius: Radius of the indenter, mm; inf: a plate.
        delta: (D,) penetrations, ascending, mm.
        polar: (T,) polar angles at which the field is sampled, rad.
    """
    profiles = list(press(dome, radius, delta, polar))
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
    """Return the (..., T) finite rotation of the normal of a displaced meridian, rad.

    The tangent of (r - w) b + t e is (r - w + t') e - (w' + t) b; to first order the rotation is
    (dw/dtheta + t) / r.

    Args:
        radius: Radius r of the meridian, mm.
        polar: (T,) polar angles, rad.
        w: (..., T) inward displacement, mm.
        t: (..., T) tangential displacement away from the contact, mm.
    """
    slope_w = CubicSpline(polar, w, axis=-1)(polar, 1)
    slope_t = CubicSpline(polar, t, axis=-1)(polar, 1)
    rotation: Array = np.arctan2(slope_w + t, radius - w + slope_t)
    rotation[..., 0] = 0.0
    return rotation


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Make tables of single-contact fields.")
    parser.add_argument("out", type=output_file)
    parser.add_argument(
        "--radius",
        type=number(SMALLEST_MM),
        action="append",
        help="of a spherical tip, mm; inf: a plate; OUT holds these only (default: 3 and inf)",
    )
    parser.add_argument("--stiffness-ratio", type=number(1, 10_000), help="E_skin / E_gel")
    parser.add_argument("--skin", type=number(0.3, 4), help="thickness, mm")
    parser.add_argument("--corrections", type=Path, metavar="FOLDER")
    given = parser.parse_args(arguments)
    settings = {"stiffness_ratio": given.stiffness_ratio, "skin": given.skin}
    dome = fem.Dome(**{name: value for name, value in settings.items() if value is not None})
    radii = given.radius or RADII
    write_file(
        given.out,
        lambda: tabulate(given.out, dome, radii, report_progress, given.corrections),
    )


if __name__ == "__main__":
    main()
