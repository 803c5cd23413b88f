"""Make tables of single presses from axisymmetric finite-element runs.

    PYTHONPATH=.:plugins python scripts/fem/tabulate_presses.py dome OUT [--radius R ...]
    PYTHONPATH=.:plugins python scripts/fem/tabulate_presses.py domes OUT
    PYTHONPATH=.:plugins python scripts/fem/tabulate_presses.py pad OUT [--radius R ...]

dome: the dome of a TacTip, half a minute a radius; domes: the eight domes around the nominal one,
for sensor instances, in twenty minutes; pad: the flat pad of the planar sensor. Give OUT to a
sensor with --param sensor.table=OUT. Corrections for contacts off the apex and for pairs are no
part of such a file; docs/decisions/simulator.md says how those that ship were made.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from axisymmetric import Array, Pad, press, press_pad
from elements import Dome, NotConvergedError, Settings
from fem_script import number, output_file, report_progress, solver, write_file, write_tables
from scipy.interpolate import CubicSpline

from tactibench_sim import (
    QUANTUM,
    RATIO_FACTOR,
    SKIN_FACTOR,
    SMALLEST_MM,
    Table,
    Tables,
    shape_name,
    shipped_dome,
)

RADII = (3.0, math.inf)
"""Indenters of the file that ships, mm; inf: a plate."""
DEEPEST_MM, STEP_MM = 6.5, 0.125
POLAR_STEP_DEG = 0.5


def tabulate_dome(path: Path, dome: Dome, radii: Sequence[float] = RADII) -> str:
    """Press spheres on a dome, write the file of their tables and return its digest.

    Nothing is written unless every run converged.

    Args:
        path: File to write.
        dome: Dome that is pressed.
        radii: Radii of the spheres, mm; inf: a plate.

    Raises:
        UserError: NGSolve is not installed.
        NotConvergedError: A run failed.
    """
    delta = np.arange(round(DEEPEST_MM / STEP_MM) + 1, dtype=np.float64) * STEP_MM
    polar = np.radians(np.arange(round(90 / POLAR_STEP_DEG) + 1, dtype=np.float64) * POLAR_STEP_DEG)
    arrays: dict[str, npt.NDArray[Any]] = {"delta": delta, "polar": polar}
    for shape, radius in {shape_name(radius): radius for radius in radii}.items():
        report_progress(shape)
        for quantity, values in columns(dome, radius, delta, polar).items():
            arrays[f"{shape}_{quantity}"] = values.astype(np.float32)
    return write_tables(path, arrays, {"dome": asdict(dome), "solver": solver()})


def columns(dome: Dome, radius: float, delta: Array, polar: Array) -> dict[str, Array]:
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


NODES = (-1, 0, 1)
EVERY = 2
"""Every second depth and angle of the tables is kept: 0.25 mm and 1 deg."""


def tabulate_domes(path: Path, nominal: Tables) -> str:
    """Press indenters on the eight domes around the nominal one and return the file's digest.

    It takes twenty minutes. Nothing is written unless every run converged.

    Args:
        path: File to write.
        nominal: Tables of the nominal dome, which name the indenters.

    Raises:
        UserError: NGSolve is not installed.
        NotConvergedError: A run failed.
    """
    middle = Dome(**nominal.parameters["dome"])
    first = next(iter(nominal.by_radius.values()))
    delta, polar = first.delta[::EVERY], first.polar
    arrays: dict[str, npt.NDArray[Any]] = {"delta": delta, "polar": polar[::EVERY]}
    for radius, table in nominal.by_radius.items():
        shape = shape_name(radius)
        changes = empty(table)
        for i, j in ((i, j) for i in NODES for j in NODES if (i, j) != (0, 0)):
            dome = replace(
                middle,
                stiffness_ratio=middle.stiffness_ratio * RATIO_FACTOR**i,
                skin=middle.skin * SKIN_FACTOR**j,
            )
            report_progress(f"{shape}, ratio {dome.stiffness_ratio:g}, skin {dome.skin:g} mm")
            for name, values in columns(dome, radius, delta, polar).items():
                changes[name][i + 1, j + 1] = change(name, values, table.fields[name])
        arrays |= {f"{shape}_{name}": values for name, values in changes.items()}
    parameters = {
        "dome": nominal.parameters["dome"],
        "ratio_factor": RATIO_FACTOR,
        "skin_factor": SKIN_FACTOR,
        "solver": solver(),
    }
    return write_tables(path, arrays, parameters)


def empty(table: Table) -> dict[str, npt.NDArray[Any]]:
    """Return zero arrays (3, 3, D, T) of whole numbers, and (3, 3, D) of floats for the force."""
    out: dict[str, npt.NDArray[Any]] = {}
    for name, field in table.fields.items():
        coarse = field[::EVERY] if name == "force" else field[::EVERY, ::EVERY]
        kind = np.float32 if name == "force" else np.int16
        out[name] = np.zeros((3, 3, *coarse.shape), dtype=kind)
    return out


def change(name: str, values: Array, nominal: Array) -> npt.NDArray[Any]:
    """Return the difference of a dome's quantity from the nominal table, as it is stored.

    Args:
        name: Name of the quantity.
        values: Values of the dome at every second depth and all polar angles; (D,) for the force.
        nominal: Values of the nominal table at all depths and polar angles.

    Raises:
        ValueError: A difference is more than 16 bits can hold.
    """
    added: Array = values - nominal[::EVERY]
    if name == "force":
        return added
    multiples: Array = np.rint(added[:, ::EVERY] / QUANTUM)
    if abs(multiples).max() > np.iinfo(np.int16).max:
        raise ValueError(f"{name} differs by {abs(added).max():g}, more than fits")
    return multiples.astype(np.int16)


PAD_QUANTITIES = ("w", "t", "w_surface", "t_surface", "force")
PAD = Pad(
    thickness=5.0,
    skin=0.0,
    stiffness_ratio=1.0,
    width=120.0,
    marker_depth=0.5,
    contact_size=0.1,
    contact_radius=5.0,
    gel_size=1.0,
    penalty=500.0,
)
"""Gel alone, so that forces are in its own modulus; 5 mm thick and without a stiff coat (assumed;
the gel of a GelSight Mini is 4.5 mm in the simulator TacEx). Markers half a millimetre deep, under
a cover (assumed). Wide enough for its bulge, which decays by e every 5 mm / 0.739 = 6.8 mm."""

PAD_DEEPEST_MM = 3.0
"""Greatest penetration, which is the radius of the protocols' tips. Beyond it a rod's
wall shears the surface: runs stopped at 3.3 to 3.5 mm on every mesh that was tried."""
FARTHEST_MM, R_STEP_MM = 45.0, 0.1
STEPS_MM = (0.05, 0.025, 0.0125)
"""Largest increments, tried in turn: after a long increment a surface element may be folded."""
FOLD_MM = 0.05
"""Third difference of the surface between nodes: 0.02 at most while smooth, 0.2 at a fold."""


def tabulate_pad(path: Path, pad: Pad = PAD, radii: Sequence[float] = (3.0,)) -> str:
    """Press spheres on a pad, write the file of their tables and return its digest.

    Nothing is written unless every run converged.

    Args:
        path: File to write.
        pad: Pad that is pressed.
        radii: Radii of the spheres, mm.

    Raises:
        UserError: NGSolve is not installed, or a radius is infinite.
        NotConvergedError: A run failed.
    """
    deepest = min(PAD_DEEPEST_MM, *radii)
    delta = np.arange(int(deepest / STEP_MM + 1e-9) + 1, dtype=np.float64) * STEP_MM
    r = np.arange(round(FARTHEST_MM / R_STEP_MM) + 1, dtype=np.float64) * R_STEP_MM
    each = []
    for radius in sorted(radii):
        report_progress(f"sphere of {radius:g} mm")
        each.append(press_smoothly(pad, radius, delta, r))
    arrays = {q: np.stack([one[q] for one in each]).astype(np.float32) for q in PAD_QUANTITIES}
    axes = {"radii": np.array(sorted(radii)), "delta": delta, "r": r}
    return write_tables(path, {**axes, **arrays}, {"pad": asdict(pad), "solver": solver()})


def press_smoothly(pad: Pad, radius: float, delta: Array, r: Array) -> dict[str, Array]:
    """Return the quantities of one tip: (D, N) each, mm; force (D,), E_skin mm^2.

    Args:
        pad: Pad that is pressed.
        radius: Radius of the sphere, mm.
        delta: (D,) penetrations, mm.
        r: (N,) distances from the axis, mm.

    Raises:
        NotConvergedError: A run failed, or the surface folded with every increment.
    """
    for largest in STEPS_MM:
        settings = Settings(cap=0.1, largest=largest, steps=40, smallest=2e-4)
        profiles = list(press_pad(pad, radius, delta, r, settings=settings))
        w_surface, t_surface = np.stack([profile.surface for profile in profiles], axis=1)
        if abs(np.diff(w_surface, n=3, axis=1)).max() < FOLD_MM:
            w, t = np.stack([profile.marker for profile in profiles], axis=1)
            force = np.array([profile.force for profile in profiles])
            return dict(zip(PAD_QUANTITIES, (w, t, w_surface, t_surface, force), strict=True))
    raise NotConvergedError(f"the pad's surface folded under a sphere of {radius:g} mm")


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Make tables of single presses.")
    parser.add_argument("what", choices=("dome", "domes", "pad"))
    parser.add_argument("out", type=output_file)
    parser.add_argument(
        "--radius",
        type=number(SMALLEST_MM),
        action="append",
        help="of a spherical tip, mm; inf: a plate; OUT holds these only",
    )
    parser.add_argument("--stiffness-ratio", type=number(1, 10_000), help="E_skin / E_gel")
    parser.add_argument("--skin", type=number(0.3, 4), help="thickness, mm")
    given = parser.parse_args()
    settings = {"stiffness_ratio": given.stiffness_ratio, "skin": given.skin}
    settings = {name: value for name, value in settings.items() if value is not None}
    if given.what == "dome":
        radii = given.radius or RADII
        write_file(given.out, lambda: tabulate_dome(given.out, Dome(**settings), radii))
    elif given.what == "domes":
        write_file(given.out, lambda: tabulate_domes(given.out, shipped_dome()))
    else:
        pad, radii = replace(PAD, **settings), given.radius or (3.0,)
        write_file(given.out, lambda: tabulate_pad(given.out, pad, radii))


if __name__ == "__main__":
    main()
