"""Make the file of other domes (see ``domes``) from finite-element runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim import fem, sealed, table
from tactibench_sim.domes import QUANTUM
from tactibench_sim.instances import RATIO_FACTOR, SKIN_FACTOR
from tactibench_sim.tabulate import columns

Array = npt.NDArray[np.float64]
NODES = (-1, 0, 1)
EVERY = 2
"""Every second depth and angle of the tables is kept: 0.25 mm and 1 deg."""


def tabulate_domes(
    path: Path, nominal: table.Tables, told: Callable[[str], None] = lambda _: None
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
    for radius, one in nominal.by_radius.items():
        shape = table.shape_of(radius)
        changes = empty(one)
        for i, j in ((i, j) for i in NODES for j in NODES if (i, j) != (0, 0)):
            dome = replace(
                middle,
                stiffness_ratio=middle.stiffness_ratio * RATIO_FACTOR**i,
                skin=middle.skin * SKIN_FACTOR**j,
            )
            told(f"{shape}, ratio {dome.stiffness_ratio:g}, skin {dome.skin:g} mm")
            for name, values in columns(dome, radius, delta, polar).items():
                changes[name][i + 1, j + 1] = change(name, values, one.fields[name])
        arrays |= {f"{shape}_{name}": values for name, values in changes.items()}
    parameters = {
        "dome": nominal.parameters["dome"],
        "ratio_factor": RATIO_FACTOR,
        "skin_factor": SKIN_FACTOR,
        "solver": f"ngsolve {ngsolve.__version__}",
    }
    return sealed.write(path, arrays, parameters)


def empty(one: table.Table) -> dict[str, npt.NDArray[Any]]:
    """Arrays (3, 3, D, T) of whole numbers, and the force's (3, 3, D)."""
    out: dict[str, npt.NDArray[Any]] = {}
    for name, field in one.fields.items():
        kept = field[::EVERY] if name == "force" else field[::EVERY, ::EVERY]
        kind = np.float32 if name == "force" else np.int16
        out[name] = np.zeros((3, 3, *kept.shape), dtype=kind)
    return out


def change(name: str, values: Array, nominal: Array) -> npt.NDArray[Any]:
    """What a dome's column (D, T), or force (D,), adds to the table's, as it is stored."""
    added: Array = values - nominal[::EVERY]
    if name == "force":
        return added
    whole: Array = np.rint(added[:, ::EVERY] / QUANTUM)
    if abs(whole).max() > np.iinfo(np.int16).max:
        raise ValueError(f"{name} differs by {abs(added).max():g}, more than fits")
    return whole.astype(np.int16)
