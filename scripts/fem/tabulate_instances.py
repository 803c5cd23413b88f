"""Make the file of other domes, for sensor instances, from finite-element runs.

    PYTHONPATH=.:plugins python scripts/fem/tabulate_instances.py OUT

It takes twenty minutes. ``tactibench_sim.instances`` explains the content of the file.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from fem_script import output_file, report_progress, write_file
from tabulate_dome import columns

from tactibench_sim import data_file, fem
from tactibench_sim.instances import QUANTUM, RATIO_FACTOR, SKIN_FACTOR
from tactibench_sim.mechanics.tables import Table, Tables, shape_name, shipped

Array = npt.NDArray[np.float64]
NODES = (-1, 0, 1)
EVERY = 2
"""Every second depth and angle of the tables is kept: 0.25 mm and 1 deg."""


def tabulate_instances(
    path: Path, nominal: Tables, progress: Callable[[str], None] = lambda _: None
) -> str:
    """Press indenters on the eight domes around the nominal one and return the file's digest.

    It takes twenty minutes. Nothing is written unless every run converged.

    Args:
        path: File to write.
        nominal: Tables of the nominal dome, which name the indenters.
        progress: Function that is told the name of each run before it starts.

    Raises:
        UserError: NGSolve is not installed.
        fem.NotConvergedError: A run failed.
    """
    ngsolve = fem.require_ngsolve()
    middle = fem.Dome(**nominal.parameters["dome"])
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
            progress(f"{shape}, ratio {dome.stiffness_ratio:g}, skin {dome.skin:g} mm")
            for name, values in columns(dome, radius, delta, polar).items():
                changes[name][i + 1, j + 1] = change(name, values, table.fields[name])
        arrays |= {f"{shape}_{name}": values for name, values in changes.items()}
    parameters = {
        "dome": nominal.parameters["dome"],
        "ratio_factor": RATIO_FACTOR,
        "skin_factor": SKIN_FACTOR,
        "solver": f"ngsolve {ngsolve.__version__}",
    }
    return data_file.write(path, arrays, parameters)


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


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Make the tables of other domes.")
    parser.add_argument("out", type=output_file)
    given = parser.parse_args()
    write_file(given.out, lambda: tabulate_instances(given.out, shipped(), report_progress))


if __name__ == "__main__":
    main()
