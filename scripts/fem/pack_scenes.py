"""Pack finite-element runs into the reference scenes that ship.

    PYTHONPATH=.:plugins python scripts/fem/pack_scenes.py OUT RUN.npz ...

A run is an npz file of the arrays

* ``d``: (D,) depths, mm;
* ``tips``: (K, 3) x and y of each tip, mm, and its share of ``d``;
* ``sym``: true where every tip with y > 0 has its mirror image;
* ``pu``, ``pn``: (D, P, 3) displacement, mm, and normal at the pins of ``layout``, in the order of
  LAYOUTS.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt
from fem_script import output_file, write_file

from tactibench import UserError
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim import data_file
from tactibench_sim.pins import layout
from tactibench_sim.reference_frames.scenes import LAYOUTS, RADIUS_MM, STEP_MM, STEP_NORMAL

Array = npt.NDArray[np.float64]
PARAMETERS = {
    "dome": {"outer": 20.0, "skin": 1.0, "stiffness_ratio": 50.0, "penalty": 60.0},
    "indenter": {"radius": RADIUS_MM, "shape": "rod with a spherical end, moved along -z"},
    "mesh": {
        "elements": "tetrahedra, geometry of order 2",
        "near_tips": 1.0,
        "near_within": 6.0,
        "elsewhere": 4.0,
        "grading": 0.3,
    },
    "elements": "displacement order 2, pressure order 1 (one for skin, one for gel)",
    "material": "neo-Hooke, exactly incompressible",
    "contact": "frictionless penalty, smoothed over 0.01 mm",
    "newton_mm": 1e-3,
    "isolated": {
        "near_tips": 1.2,
        "elsewhere": 4.5,
        "moved": "along the normal of the skin, axis of the rod likewise",
        "read": "off a chart of 2.5 deg with cubic splines",
    },
}
"""Parameters of the runs; lengths are in mm, moduli in units of the skin's."""
_RESTING_DEG = 0.6
"""Largest turn of normals 45 deg away from every tip, for each mm of depth (seen: 0.45)."""


def pack(paths: Sequence[Path], out: Path) -> str:
    """Write the file of the reference scenes and return its sha256.

    Raises:
        UserError: No run is given, or a run cannot be read, has arrays of other shapes, values that
            are not finite or too large, or was made for other pins than those of ``layout``.
    """
    if not paths:
        raise UserError("there are no runs to pack; give their npz files.")
    directions = np.concatenate([layout(pins) for pins in LAYOUTS])
    arrays: dict[str, npt.NDArray[Any]] = {"directions": directions}
    runs = []
    for path in sorted(paths):
        name = path.stem.removeprefix("val_")
        packed = _packed(path, _run(path), directions)
        arrays |= {f"{name}_{key}": array for key, array in packed.items()}
        runs.append(name)
    parameters = {**PARAMETERS, "runs": runs, "solver": f"ngsolve {_solver()}"}
    return data_file.write(out, arrays, parameters)


def _run(path: Path) -> dict[str, npt.NDArray[Any]]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in ("d", "tips", "sym", "pu", "pn")}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise UserError(
            f"the run {path} cannot be read ({type(error).__name__}); leave it out, or wait until "
            "it is written."
        ) from None


def _packed(
    path: Path, run: Mapping[str, npt.NDArray[Any]], directions: Array
) -> dict[str, npt.NDArray[Any]]:
    u, normals, depth = run["pu"], run["pn"], np.asarray(run["d"], dtype=np.float64)
    wanted = (len(depth), *directions.shape)
    if u.shape != wanted or normals.shape != wanted:
        raise UserError(
            f"{path} has displacements {u.shape} and normals {normals.shape}; "
            f"they must be {wanted}."
        )
    if not (np.isfinite(u).all() and np.isfinite(normals).all()):
        raise UserError(f"{path} holds a value that is not finite; run it again.")
    if abs(u).max() > 32767 * STEP_MM:
        raise UserError(f"{path} moves a pin by {abs(u).max():g} mm, more than the file can hold.")
    tips = np.asarray(run["tips"], dtype=np.float64)
    if run["sym"]:
        tips = np.concatenate([tips, tips[tips[:, 1] > 1e-9] * (1.0, -1.0, 1.0)])
        u, normals = _in_the_plane(u, directions), _in_the_plane(normals, directions)
    turned = _turned_far_away(tips, directions, normals[0])
    if turned > _RESTING_DEG * depth[0]:
        raise UserError(
            f"{path} has normals {turned:.2f} deg off at pins far from its tips; it was made for "
            "other pins than those of `layout`, so run it again."
        )
    return {
        "tips": tips,
        "depth": depth,
        "u": np.rint(u / STEP_MM).astype(np.int16),
        "normal": np.rint(normals / STEP_NORMAL).astype(np.int16),
    }


def _turned_far_away(tips: Array, directions: Array, normals: Array) -> float:
    """Return the largest turn of the normals that are more than 45 deg from every tip, deg."""
    at = np.concatenate([tips[:, :2], np.zeros((len(tips), 1))], axis=1)
    at[:, 2] = np.sqrt((DOME_RADIUS_MM + RADIUS_MM) ** 2 - (at**2).sum(axis=1))
    along = directions @ at.T / (DOME_RADIUS_MM + RADIUS_MM)
    far = along.max(axis=1) < np.cos(np.pi / 4)
    turned: Array = np.degrees(np.linalg.norm(normals - directions, axis=1))
    return float(turned[far].max())


def _in_the_plane(vectors: Array, directions: Array) -> Array:
    """Return vectors of pins in which those in the plane of symmetry y = 0 have no y component.

    By symmetry there is none, but a run sees one side of the plane only, so that its differences
    across the plane are one-sided.
    """
    out: Array = vectors.copy()
    out[:, abs(directions[:, 1]) < 1e-9, 1] = 0.0
    return out


def _solver() -> str:
    try:
        return version("ngsolve")
    except PackageNotFoundError:
        return "of an unknown version"


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Pack finite-element runs into one file.")
    parser.add_argument("out", type=output_file)
    parser.add_argument("runs", type=Path, nargs="+")
    given = parser.parse_args()
    write_file(given.out, lambda: pack(given.runs, given.out))


if __name__ == "__main__":
    main()
