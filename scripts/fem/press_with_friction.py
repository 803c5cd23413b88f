"""Press scenes with friction by finite elements: bounds and tests are made from them.

    PYTHONPATH=.:plugins python scripts/fem/press_with_friction.py runs/

No table is made from these runs. A run takes 5 to 40 minutes and leaves a file RUN.npz in the
folder; a run whose file is there is not made again, so that an interrupted command goes on. A file
holds the directions of (P, 3) pins, the (D, K, 3) tips where they end, x, y and depth, mm, the
(D, 2) ``way`` that they went sideways before that, mm, (D, P, 3) displacements ``u`` of the pin
bases, mm, outward normals ``normal`` of the inner skin there, and (D, K, 2, 3) normal and
tangential ``force`` on the skin, E_skin mm^2; radius, mm, and coefficient of friction are its
parameters. gather_scenes.py takes those that went straight down.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
from elements import Dome
from fem_script import output_file, report_progress, solver, write_file, write_tables
from friction import RubbingPress
from spatial import Fineness, SpatialField, SpatialPress, Tip

from tactibench_sim import layout

Array = npt.NDArray[np.float64]
Place = tuple[float, float]
_TURN_RAD = 0.012
"""Normals are differences over twice this angle, about a quarter of an element's edge."""


@dataclass(frozen=True)
class Run:
    """Tips that go down with friction, and then sideways.

    Attributes:
        name: Name of the run.
        friction: Coulomb's coefficient.
        places: x and y where each tip goes down, mm; one beside the plane y = 0 stands for itself
            and its image.
        depths: Greatest depth of each tip, mm.
        levels: Ways of the deepest tip, down and then sideways, at which the field is taken, mm.
        radius: Radius of every tip, mm; inf: a plate.
        direction: Unit vector of the way sideways.
    """

    name: str
    friction: float
    places: tuple[Place, ...]
    depths: tuple[float, ...]
    levels: tuple[float, ...]
    radius: float = 3.0
    direction: Place = (1.0, 0.0)


RUNS = (
    Run("rub_single8", 0.5, ((8, 0),), (3.0,), (1, 2, 3)),
    Run("rub_single10", 0.5, ((4, 0),), (5.0,), (1, 3, 5)),
    Run("rub_single10m3", 0.3, ((10, 0),), (4.0,), (2, 4)),
    Run("rub_single20", 0.2, ((7.87, 0),), (3.0,), (1, 2, 3)),
    Run("rub_single30", 1.0, ((11.5, 0),), (3.0,), (1, 2, 3)),
    Run("rub_pair7.5", 0.5, ((-3.75, 0), (3.75, 0)), (2.0, 2.0), (1, 2)),
    Run("rub_pairoff", 0.5, ((5, 4.25),), (2.0,), (1, 2)),
    Run("rub_pair10m3", 0.3, ((-5, 0), (5, 0)), (4.0, 4.0), (2, 4)),
    Run("rub_unequal", 0.5, ((6, 0), (-3, 0)), (3.0, 3.0), (1.5, 3)),
    Run("rub_uneven", 0.5, ((-3.75, 0), (3.75, 0)), (3.0, 1.5), (3,)),
    Run("rub_triple", 0.5, ((4.62, 0), (-2.31, 4)), (3.0, 3.0), (1.5, 3)),
    Run("rub_tripleoff", 0.5, ((9.2, 0), (2.7, 3.75)), (2.0, 2.0), (1, 2)),
    Run("back_5", 0.8, ((5, 0),), (1.5,), (1.8, 2.3), direction=(-1.0, 0.0)),
    Run("sharp_5", 0.6, ((5, 0),), (1.5,), (1, 1.5, 2.0), radius=1.5),
)


def press_run(run: Run, path: Path) -> str:
    """Press one run, write its file and return its digest.

    Raises:
        UserError: NGSolve is not installed.
        NotConvergedError: The run failed.
    """
    directions = np.concatenate([layout(331), layout(127)])
    dome, depths = Dome(), np.array(run.depths)
    tips = [_tip(dome, place, run.radius) for place in run.places]
    mirror = run.direction[1] == 0
    fineness = Fineness(contact=0.3, largest=1.5)
    planned = np.array([0 * depths, depths])
    press = SpatialPress(dome, tips, planned, mirror=mirror, fineness=fineness)
    rubbing = RubbingPress(press, run.friction, depths, run.direction)
    rows: dict[str, list[Array]] = {n: [] for n in ("tips", "way", "u", "normal", "force")}
    for level in run.levels:
        field = rubbing.move(level)
        way = max(level - depths.max(), 0.0) * np.array(run.direction)
        ends, force = [], []
        for k, place in enumerate(run.places):
            for side in (1.0, -1.0) if mirror and place[1] else (1.0,):
                at = np.array([place[0], side * place[1]])
                depth = rubbing.depths(level)[k] + _rise(run.radius, at, at + way)
                ends.append([*(at + way), depth])
                force.append(rubbing.forces[k] * [1.0, side, 1.0])
        rows["tips"].append(np.array(ends))
        rows["force"].append(np.array(force))
        rows["way"].append(way)
        rows["u"].append(field.inner(directions))
        rows["normal"].append(normals(field, directions))
    arrays = {"directions": directions, **{name: np.array(row) for name, row in rows.items()}}
    parameters = {"radius": run.radius, "friction": run.friction, "solver": solver()}
    return write_tables(path, arrays, parameters)


def _rise(radius: float, start: Array, end: Array) -> float:
    """Return by how much a tip that keeps its height is deeper at its end, mm."""
    if math.isinf(radius):
        return 0.0
    before, after = (math.sqrt((20.0 + radius) ** 2 - float(at @ at)) for at in (start, end))
    return after - before


def _tip(dome: Dome, place: Place, radius: float) -> Tip:
    if math.isinf(radius):
        return Tip.along_axis(dome, np.array([0.0, 0.0, 1.0]), radius)
    return Tip.downwards(dome, *place, radius)


def normals(field: SpatialField, directions: Array) -> Array:
    """Return the (P, 3) outward normals of the pressed inner skin at (P, 3) directions."""
    other = np.where(abs(directions[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    e = np.cross(directions, other)
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    inner = field.dome.outer - field.dome.skin

    def place(along: Array) -> Array:
        at = along / np.linalg.norm(along, axis=1, keepdims=True)
        return np.asarray(inner * at + field.inner(at))

    one, other = (
        place(directions + _TURN_RAD * axis) - place(directions - _TURN_RAD * axis)
        for axis in (e, np.cross(directions, e))
    )
    out = np.cross(one, other)
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Press the scenes with friction.")
    parser.add_argument("folder", type=output_file)
    parser.add_argument("runs", nargs="*", help="names of runs; none: all")
    given = parser.parse_args()
    given.folder.mkdir(exist_ok=True)
    for run in RUNS:
        path = given.folder / f"{run.name}.npz"
        if not path.exists() and run.name in (given.runs or [run.name]):
            report_progress(f"run {run.name}")
            write_file(path, partial(press_run, run, path))


if __name__ == "__main__":
    main()
