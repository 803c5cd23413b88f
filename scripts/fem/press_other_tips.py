"""Make the scenes of other tips that the tables are tested with, by finite elements.

    PYTHONPATH=.:plugins python scripts/fem/press_other_tips.py tests/sim/other_tips.npz

Four minutes. One or two tips of one radius that move along -z, on and off the apex; no table was
made from these runs. The file holds (S,) radii, (S, 2, 2) places and (S, 2) depths of the tips, mm,
NaN for no second tip, and (S, 127, 3) displacements of the pin bases, mm.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from fem_script import output_file, report_progress, write_file

from tactibench_sim import data_file, fem
from tactibench_sim.fem.press import SpatialPress
from tactibench_sim.fem.tip import Tip
from tactibench_sim.pins import layout

Place = tuple[float, float]
SCENES: tuple[tuple[float, tuple[Place, ...], tuple[tuple[float, ...], ...]], ...] = (
    (1.0, ((3, 0), (6, 0)), ((0.6, 0.6), (1.2, 1.2))),
    (1.0, ((-1.6, 0), (1.6, 0)), ((0.5, 0.5), (1, 1), (1.4, 0.7), (1.5, 1.5))),
    (1.0, ((5, 0),), ((0.5,), (1.0,), (1.5,))),
    (1.75, ((-2.5, 0), (2.5, 0)), ((0.8, 0.8), (1.6, 1.6), (2.4, 1.2), (2.6, 2.6))),
    (2.0, ((-3, 0), (3, 0)), ((1, 1), (2, 1), (3, 3))),
    (2.2, ((10, 0),), ((1.0,), (2.0,), (3.0,))),
    (4.5, ((2, 0), (10, 0)), ((1, 1), (2, 2), (3, 3))),
    (6.0, ((-4, 0), (4, 0)), ((1, 1), (2, 2), (3, 1.5), (3, 3))),
    (7.0, ((8, 0),), ((1.0,), (2.0,), (3.0,))),
    (8.0, ((-6, 0), (6, 0)), ((1, 1), (3, 3))),
)
"""Radius, places of the tips, and the depths that they are taken to in turn, mm."""


def make(path: Path) -> str:
    """Press all scenes, write the file and return its digest. Raises fem.NotConvergedError."""
    dome, pins = fem.Dome(), layout(127)
    side = np.where(pins[:, 1] < 0, -1.0, 1.0)  # the mesh is the half y > 0
    radius, xy, depth, moved = [], [], [], []
    for size, places, depths in SCENES:
        report_progress(f"{len(places)} of R = {size:g} mm")
        way = np.array(depths, dtype=np.float64)
        tips = [Tip.downwards(dome, *place, size) for place in places]
        press = SpatialPress(dome, tips, way, mirror=True)
        for row in way:
            press.move(row)
            u = press.field().inner(np.column_stack([pins[:, 0], abs(pins[:, 1]), pins[:, 2]]))
            moved.append(u * np.column_stack([np.ones_like(side), side, np.ones_like(side)]))
            missing = 2 - len(places)
            radius.append(size)
            xy.append([*places, *[(np.nan, np.nan)] * missing])
            depth.append([*row, *[np.nan] * missing])
    arrays = {
        "radius": np.array(radius),
        "xy": np.array(xy, dtype=np.float64),
        "depth": np.array(depth),
        "displacement": np.array(moved, dtype=np.float32),
    }
    return data_file.write(path, arrays, {"scenes": len(radius)})


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Press tips of other radii by finite elements.")
    parser.add_argument("out", type=output_file)
    given = parser.parse_args()
    write_file(given.out, lambda: make(given.out))


if __name__ == "__main__":
    main()
