"""Make the file of other domes, for sensor instances, from finite-element runs.

    PYTHONPATH=.:plugins python scripts/fem/tabulate_instances.py OUT

Twenty minutes. See ``tactibench_sim.instances`` for what the file holds.
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
    """Press the indenters of ``nominal`` on the eight domes around its own; the file's digest.

    Twenty minutes. Nothing is written unless every run converged. Raises UserError without NGSolve,
    fem.NotConvergedError where a run fails.
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
    """Arrays (3, 3, D, T) of whole numbers, and the force's (3, 3, D)."""
    out: dict[str, npt.NDArray[Any]] = {}
    for name, field in table.fields.items():
        coarse = field[::EVERY] if name == "force" else field[::EVERY, ::EVERY]
        kind = np.float32 if name == "force" else np.int16
        out[name] = np.zeros((3, 3, *coarse.shape), dtype=kind)
    return out


def change(name: str, values: Array, nominal: Array) -> npt.NDArray[Any]:
    """Return a dome's column (D, T), or force (D,), minus the table's, as it is stored."""
    added: Array = values - nominal[::EVERY]
    if name == "force":
        return added
    whole: Array = np.rint(added[:, ::EVERY] / QUANTUM)
    if abs(whole).max() > np.iinfo(np.int16).max:
        raise ValueError(f"{name} differs by {abs(added).max():g}, more than fits")
    return whole.astype(np.int16)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Make the tables of other domes.")
    parser.add_argument("out", type=output_file)
    given = parser.parse_args()
    write_file(given.out, lambda: tabulate_instances(given.out, shipped(), report_progress))


if __name__ == "__main__":
    main()
