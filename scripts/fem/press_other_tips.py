"""Make the reference scenes of tips of other radii, by finite elements.

    PYTHONPATH=.:plugins python scripts/fem/press_other_tips.py OUT RUNS

OUT ships as plugins/tactibench_sim/reference_frames/other_tips.npz. It takes a quarter of an hour;
every press is kept in the folder RUNS, and the script goes on where it stopped. One or two tips of
one radius move along -z, on and off the apex; no table was made from these runs.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from fem_script import output_file, report_progress, write_file

from tactibench.lab import atomic
from tactibench_sim import data_file, fem
from tactibench_sim.fem.press import SpatialPress
from tactibench_sim.fem.tip import Tip
from tactibench_sim.pins import layout
from tactibench_sim.reference_frames.scenes import STEP_MM

Arrays = Mapping[str, np.ndarray[Any, Any]]


class Run(NamedTuple):
    """Tips of one radius at some places, and the depths to which they are pressed in turn.

    Attributes:
        radius: Radius of every tip, mm.
        places: x and y of each tip, mm. A place beside the plane y = 0 stands for itself and its
            mirror image.
        depths: Depths of all tips, mm, one row after the other.
    """

    radius: float
    places: tuple[tuple[float, float], ...]
    depths: tuple[tuple[float, ...], ...]


RUNS = {
    "p6.5_r1_off5": Run(1, ((1.75, 0), (8.25, 0)), ((0.5, 0.5), (1, 1), (1.5, 0.75), (1.5, 1.5))),
    "p2_r1_off4": Run(1, ((3, 0), (5, 0)), ((0.5, 0.5), (1, 1), (1.5, 0.75), (1.5, 1.5))),
    "p4.5_r1_side6": Run(1, ((6, 2.25),), ((0.5,), (1,), (1.5,))),
    "p4_r1_off7.5": Run(1, ((5.5, 0), (9.5, 0)), ((0.5, 0.5), (1, 1), (1.5, 1.5))),
    "p5_r2.5_off6": Run(2.5, ((3.5, 0), (8.5, 0)), ((1, 1), (2, 1), (3, 3))),
    "p8_r4": Run(4, ((-4, 0), (4, 0)), ((1, 1), (2, 2), (4, 2), (4, 4))),
    "s_r1.4_16": Run(1.4, ((16, 0),), ((0.7,), (1.4,), (2.1,))),
    "s_r2.7_6": Run(2.7, ((6, 0),), ((1,), (2,), (4,))),
    "s_r5_14": Run(5, ((14, 0),), ((1,), (2,), (4,))),
    "s_r7.5_2": Run(7.5, ((2, 0),), ((1,), (2,), (4,))),
    "p3_r1_off4.5": Run(1, ((3, 0), (6, 0)), ((0.6, 0.6), (1.2, 1.2))),
    "p3.2_r1": Run(1, ((-1.6, 0), (1.6, 0)), ((0.5, 0.5), (1, 1), (1.4, 0.7), (1.5, 1.5))),
    "s_r1_5": Run(1, ((5, 0),), ((0.5,), (1.0,), (1.5,))),
    "p5_r1.75": Run(1.75, ((-2.5, 0), (2.5, 0)), ((0.8, 0.8), (1.6, 1.6), (2.4, 1.2), (2.6, 2.6))),
    "p6_r2": Run(2, ((-3, 0), (3, 0)), ((1, 1), (2, 1), (3, 3))),
    "s_r2.2_10": Run(2.2, ((10, 0),), ((1,), (2,), (3,))),
    "p8_r4.5_off6": Run(4.5, ((2, 0), (10, 0)), ((1, 1), (2, 2), (3, 3))),
    "p8_r6": Run(6, ((-4, 0), (4, 0)), ((1, 1), (2, 2), (3, 1.5), (3, 3))),
    "s_r7_8": Run(7, ((8, 0),), ((1,), (2,), (3,))),
    "p12_r8": Run(8, ((-6, 0), (6, 0)), ((1, 1), (3, 3))),
}
"""Name -> run. A name holds p and the spacing for a pair, s for a single, then the radius and the
place of the middle, mm."""


def press(run: Run) -> dict[str, Any]:
    """Return the (D, P, 3) displacements of the pin bases, mm, by the name "u".

    Raises:
        fem.NotConvergedError: The run failed.
    """
    dome, pins = fem.Dome(), layout(127)
    tips = [Tip.downwards(dome, *place, run.radius) for place in run.places]
    way = np.array(run.depths, dtype=np.float64)
    moving = SpatialPress(dome, tips, way, mirror=True)
    moved = []
    for row in way:
        moving.move(row)
        moved.append(moving.field().inner(pins))
    return {"u": np.array(moved)}


def pack(out: Path, folder: Path) -> str:
    """Make the runs that are missing in the folder, write the file and return its digest."""
    arrays: dict[str, Any] = {"directions": layout(127)}
    radius = {}
    for name, run in RUNS.items():
        file = folder / f"{name}.npz"
        if not file.is_file():
            report_progress(name)
            displacements = press(run)
            with atomic(file) as stream:
                np.savez(stream, **displacements)
        with np.load(file) as archive:
            for part, content in _by_share(run, dict(archive)).items():
                arrays |= {f"{name}{part}_{key}": array for key, array in content.items()}
                radius[f"{name}{part}"] = run.radius
    parameters = {
        "radius": radius,
        "runs": sorted(radius, key=lambda name: (radius[name], name)),
        "solver": f"ngsolve {version('ngsolve')}",
    }
    return data_file.write(out, arrays, parameters)


def _by_share(run: Run, found: Arrays) -> dict[str, dict[str, Any]]:
    """Return suffix -> scenes of a run: "" for tips of equal depth, "_un" for unequal ones."""
    images = [((x, y), (x, -y))[: 1 if y == 0 else 2] for x, y in run.places]
    places = np.array([place for pair in images for place in pair])
    depths = np.array([row * (len(places) // len(row)) for row in run.depths], dtype=float)
    share = depths / depths.max(axis=1, keepdims=True)
    equal = (share == 1).all(axis=1)
    out = {}
    for part, rows in (("", equal), ("_un", ~equal)):
        if rows.any():
            out[part] = {
                "tips": np.column_stack([places, share[rows][0]]),
                "depth": depths[rows].max(axis=1),
                "u": np.rint(found["u"][rows] / STEP_MM).astype(np.int16),
            }
    return out


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Press tips of other radii by finite elements.")
    parser.add_argument("out", type=output_file)
    parser.add_argument("runs", type=Path, help="folder of the presses")
    given = parser.parse_args()
    given.runs.mkdir(exist_ok=True)
    write_file(given.out, lambda: pack(given.out, given.runs))


if __name__ == "__main__":
    main()
