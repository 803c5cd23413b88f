"""Make the scenes of dragged skin that the tables are tested with, by finite elements.

    PYTHONPATH=.:plugins python scripts/fem/press_sideways.py sideways.npz

The file stands in tests/sim/data; no table was made from its runs, which take five minutes. One or
two tips of one radius, or a plate, go down along -z and then sideways, with Coulomb's friction of
finite size. The file holds (S,) radii and coefficients of friction, (S, 2, 2) places and (S, 2)
depths where the tips end, mm, NaN for no second tip, the (S, 2) way that they went sideways, mm,
and (S, 127, 3) displacements of the pin bases, mm.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from elements import Dome
from fem_script import output_file, report_progress, write_file, write_tables
from spatial import Drag, Fineness, SpatialPress, Tip

from tactibench_sim import layout

Array = npt.NDArray[np.float64]
Place = tuple[float, float]


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
    parser = argparse.ArgumentParser(description="Make test scenes of dragged skin.")
    parser.add_argument("out", type=output_file)
    given = parser.parse_args()
    write_file(given.out, lambda: press_sideways(given.out))


if __name__ == "__main__":
    main()
