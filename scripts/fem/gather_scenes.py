"""Gather the finite-element scenes that ship, at the pins of the sensors that ship.

    PYTHONPATH=.:plugins python scripts/fem/gather_scenes.py scenes.npz [RUN.npz ...]

It takes seconds. The file belongs in plugins/tactibench_sim/data. It has the runs of the file that
ships, and those of other files, such as press_with_friction.py writes: the directions of (P, 3)
pins, and for each run the (D, K, 3) tips, x, y and depth, mm, the (D, P, 3) displacements ``u``,
mm, and outward normals ``normal`` there, and its radius, mm, and coefficient of friction.

A scene of the file that ships is read off at pins where the runs were not. What the tables leave
of it there is smooth: it is interpolated by thin-plate splines between the pins of the runs, and
the field of the tables is added. ``leave_out`` says how far that may be off: in scenes 3 mm deep
and less, .0006 mm in the median and .009 mm in 99 % of all cases at pins that are twice as far from
the others as a new pin is; in all scenes .001 and .017 mm.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from fem_script import output_file, write_file, write_tables
from scipy.interpolate import RBFInterpolator

from tactibench import SensorContext
from tactibench_sim import (
    RADIUS_MM,
    STEP_MM,
    STEP_NORMAL,
    ReferenceScene,
    TableMechanics,
    TacTip127,
    TacTip331,
    read_file,
    reference_scenes,
    shipped_dome,
    shipped_file,
    turned_normals,
)

Array = npt.NDArray[np.float64]


def sensor_pins() -> Array:
    """Return the (P, 3) directions of the pins of the sensors that ship."""
    context = SensorContext(np.random.SeedSequence(0))
    return np.concatenate([kind(context).directions for kind in (TacTip331, TacTip127)])


def table_field(mechanics: TableMechanics, scene: ReferenceScene, at: Array) -> Array:
    """Return (P, 6) displacement, mm, and normal of the pin bases in ``at``, by the tables."""
    u, q = mechanics.displacement(mechanics.loads(scene.as_tips), at)
    return np.concatenate([u[0], turned_normals(at, q[0])], axis=1)


def at_pins(scenes: Sequence[ReferenceScene], pins: Array) -> tuple[Array, Array]:
    """Return displacements and normals, each (S, P, 3), of frictionless scenes at other pins.

    Args:
        scenes: S scenes that have their pins in common.
        pins: (P, 3) directions.
    """
    mechanics = TableMechanics(shipped_dome(), "coupled")
    known, rows = np.unique(scenes[0].directions.round(9), axis=0, return_index=True)
    given = [np.concatenate([s.displacement, s.normals], axis=1)[rows] for s in scenes]
    tables = [table_field(mechanics, scene, known) for scene in scenes]
    left = np.stack(given, axis=1) - np.stack(tables, axis=1)
    smooth = RBFInterpolator(known, left.reshape(len(known), -1))(pins)
    field = np.stack([table_field(mechanics, scene, pins) for scene in scenes], axis=1)
    u, normal = np.split(smooth.reshape(field.shape) + field, 2, axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return u.swapaxes(0, 1), normal.swapaxes(0, 1)


def gather(path: Path, runs: Sequence[Path]) -> str:
    """Write the file of scenes and return its digest.

    Args:
        path: The new file.
        runs: Files of further runs; one that ships has the name of the file as its run's.
    """
    pins, shipped = sensor_pins(), reference_scenes()
    moved: dict[str, list[tuple[Array, Array, Array]]] = defaultdict(list)
    again = {run.stem for run in runs}
    frictionless = [s for s in shipped if not s.friction and s.name not in again]
    for scene, u, normal in zip(frictionless, *at_pins(frictionless, pins), strict=True):
        moved[scene.name].append((scene.tips, u, normal))
    radius, friction = {}, {}
    for run in sorted(runs):
        file = read_file(run)
        where = _rows(file.arrays["directions"], pins)
        states = [file.arrays["tips"], *(file.arrays[name][:, where] for name in ("u", "normal"))]
        moved[run.stem] = [(tips, u, normal) for tips, u, normal in zip(*states, strict=True)]
        radius[run.stem], friction[run.stem] = (file.parameters[k] for k in ("radius", "friction"))
    arrays: dict[str, npt.NDArray[Any]] = {"directions": pins}
    for name, scenes in moved.items():
        tips, u, normal = (np.stack(values) for values in zip(*scenes, strict=True))
        arrays[f"{name}_tips"] = tips
        arrays[f"{name}_u"] = np.rint(u / STEP_MM).astype(np.int16)
        arrays[f"{name}_normal"] = np.rint(normal / STEP_NORMAL).astype(np.int16)
    parameters = {
        **shipped_file("scenes.npz").parameters,
        "runs": list(moved),
        "radius": {name: value for name, value in radius.items() if value != RADIUS_MM},
        "friction": friction,
    }
    return write_tables(path, arrays, parameters)


def _rows(directions: Array, pins: Array) -> npt.NDArray[np.intp]:
    """Return where each of (P, 3) pins stands in directions.

    Raises:
        ValueError: A pin stands in none of them.
    """
    along = pins @ directions.T
    if (along.max(axis=1) < 1 - 1e-9).any():
        raise ValueError("the run was not read off at the pins of the sensors that ship")
    return np.asarray(along.argmax(axis=1))


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Gather the finite-element scenes that ship.")
    parser.add_argument("out", type=output_file)
    parser.add_argument("runs", type=Path, nargs="*")
    given = parser.parse_args()
    write_file(given.out, lambda: gather(given.out, given.runs))


if __name__ == "__main__":
    main()
