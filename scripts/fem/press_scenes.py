"""Make the scenes that the tables are tested with, by finite elements; no table was made from them.

    PYTHONPATH=.:plugins python scripts/fem/press_scenes.py tips OUT RUNS
    PYTHONPATH=.:plugins python scripts/fem/press_scenes.py sideways OUT

They stand in tests/sim/data. tips: one or two tips of radii other than 3 mm move along -z, on and
off the apex. It takes a quarter of an hour; every press is kept in the folder RUNS, and the script
goes on where it stopped. sideways: one or two tips of one radius, or a plate, go down along -z and
then sideways, with Coulomb's friction of finite size, in five minutes. That file holds (S,) radii
and coefficients of friction, (S, 2, 2) places and (S, 2) depths where the tips end, mm, NaN for no
second tip, the (S, 2) way that they went sideways, mm, and (S, 127, 3) displacements of the pin
bases, mm.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from elements import Dome
from fem_script import output_file, report_progress, solver, write_file, write_tables
from spatial import Drag, Fineness, SpatialPress, Tip

from tactibench.lab import atomic
from tactibench_sim import STEP_MM, layout

Array = npt.NDArray[np.float64]
Arrays = Mapping[str, np.ndarray[Any, Any]]
Place = tuple[float, float]


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


def press_tips(run: Run) -> dict[str, Any]:
    """Return the (D, P, 3) displacements of the pin bases, mm, by the name "u".

    Raises:
        NotConvergedError: The run failed.
    """
    dome, pins = Dome(), layout(127)
    tips = [Tip.downwards(dome, *place, run.radius) for place in run.places]
    way = np.array(run.depths, dtype=np.float64)
    moving = SpatialPress(dome, tips, way, mirror=True)
    moved = []
    for row in way:
        moving.move(row)
        moved.append(moving.field().inner(pins))
    return {"u": np.array(moved)}


def press_other_tips(out: Path, folder: Path) -> str:
    """Make the runs that are missing in the folder, write the file and return its digest."""
    arrays: dict[str, Any] = {"directions": layout(127)}
    radius = {}
    for name, run in RUNS.items():
        file = folder / f"{name}.npz"
        if not file.is_file():
            report_progress(name)
            displacements = press_tips(run)
            with atomic(file) as stream:
                np.savez(stream, **displacements)
        with np.load(file) as archive:
            for part, content in _by_share(run, dict(archive)).items():
                arrays |= {f"{name}{part}_{key}": array for key, array in content.items()}
                radius[f"{name}{part}"] = run.radius
    parameters = {
        "radius": radius,
        "runs": sorted(radius, key=lambda name: (radius[name], name)),
        "solver": solver(),
    }
    return write_tables(out, arrays, parameters)


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


@dataclass(frozen=True)
class Slide:
    """Tips that go down to some depths, and then sideways.

    Attributes:
        radius: Radius of every tip, mm; inf: a plate, at (0, 0).
        friction: Coulomb's coefficient.
        places: x and y where each tip goes down, mm.
        depths: Depth to which each tip goes down, mm.
        direction: Unit vector of the sideways move.
        ways: Lengths of the sideways move at which the field is taken, mm.
    """

    radius: float
    friction: float
    places: tuple[Place, ...]
    depths: tuple[float, ...]
    direction: Place
    ways: tuple[float, ...]


SLIDES = (
    Slide(3.0, 0.5, ((0, 0),), (1.0,), (1, 0), (0.15, 0.5, 1.0)),
    Slide(3.0, 0.5, ((0, 0),), (3.0,), (1, 0), (0.3, 1.0, 2.0)),
    Slide(3.0, 1.0, ((0, 0),), (5.0,), (1, 0), (0.5, 1.5)),
    Slide(3.0, 0.8, ((5, 0),), (2.0,), (1, 0), (0.3, 1.0)),
    Slide(3.0, 0.8, ((5, 0),), (2.0,), (-1, 0), (0.3, 1.0)),
    Slide(3.0, 0.8, ((5, 0),), (2.0,), (0, 1), (0.3, 1.0)),
    Slide(3.0, 0.8, ((-3.5, 0), (3.5, 0)), (2.0, 2.0), (1, 0), (0.3, 1.0)),
    Slide(3.0, 0.8, ((-4, 0), (4, 0)), (3.0, 1.5), (1, 0), (0.3, 1.0)),
    Slide(1.5, 0.6, ((0, 0),), (1.5,), (1, 0), (0.2, 0.6)),
    Slide(4.0, 0.6, ((3, 0),), (2.0,), (1, 0), (0.3, 1.0)),
    Slide(math.inf, 0.5, ((0, 0),), (2.0,), (1, 0), (0.4, 1.0)),
    Slide(math.inf, 0.8, ((0, 0),), (4.0,), (1, 0), (0.5, 1.5)),
    Slide(3.0, 0.6, ((12, 0),), (2.0,), (1, 0), (0.5,)),
    Slide(3.0, 0.6, ((12, 0),), (2.0,), (-1, 0), (0.5,)),
    Slide(3.0, 0.6, ((16, 0),), (2.0,), (-1, 0), (0.5,)),
)


def press_sideways(path: Path) -> str:
    """Press all scenes, write the file and return its digest.

    Raises:
        UserError: NGSolve is not installed.
        NotConvergedError: A run failed.
    """
    dome = Dome()
    rows: dict[str, list[Array]] = {
        name: [] for name in ("radius", "friction", "xy", "depth", "move", "u")
    }
    for number, slide in enumerate(SLIDES):
        report_progress(f"scene {number + 1} of {len(SLIDES)}")
        tips = [_tip(dome, place, slide.radius) for place in slide.places]
        mirror = slide.direction[1] == 0
        start = np.array(slide.depths)
        fineness = Fineness(contact=0.3, largest=1.5)
        press = SpatialPress(dome, tips, start[None], mirror=mirror, fineness=fineness)
        press.move(start)
        drag = Drag(press, np.array(slide.direction, dtype=np.float64), slide.friction)
        for way in slide.ways:
            u = drag.move(way).inner(layout(127))
            xy, depth = _ends(slide, way)
            rows["radius"].append(np.array(slide.radius))
            rows["friction"].append(np.array(slide.friction))
            rows["xy"].append(xy)
            rows["depth"].append(depth)
            rows["move"].append(way * np.array(slide.direction, dtype=np.float64))
            rows["u"].append(u.astype(np.float32))
    return write_tables(path, {name: np.array(row) for name, row in rows.items()}, {})


def _tip(dome: Dome, place: Place, radius: float) -> Tip:
    if math.isinf(radius):
        return Tip.along_axis(dome, np.array([0.0, 0.0, 1.0]), radius)
    return Tip.downwards(dome, *place, radius)


def _ends(slide: Slide, way: float) -> tuple[Array, Array]:
    """Return places (2, 2) and depths (2,) of the tips after the move, which keeps their height."""
    xy, depth = np.full((2, 2), np.nan), np.full(2, np.nan)
    for k, (place, down) in enumerate(zip(slide.places, slide.depths, strict=True)):
        if math.isinf(slide.radius):
            xy[k], depth[k] = 0.0, down
            continue
        xy[k] = np.array(place) + way * np.array(slide.direction)
        touch = [
            math.sqrt((20.0 + slide.radius) ** 2 - float(at @ at))
            for at in (np.array(place), xy[k])
        ]
        depth[k] = down + touch[1] - touch[0]
    return xy, depth


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Press test scenes by finite elements.")
    parser.add_argument("what", choices=("tips", "sideways"))
    parser.add_argument("out", type=output_file)
    parser.add_argument(
        "runs", type=Path, nargs="?", default=Path("runs"), help="folder of presses"
    )
    given = parser.parse_args()
    if given.what == "sideways":
        write_file(given.out, lambda: press_sideways(given.out))
    else:
        given.runs.mkdir(exist_ok=True)
        write_file(given.out, lambda: press_other_tips(given.out, given.runs))


if __name__ == "__main__":
    main()
