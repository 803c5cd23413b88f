"""Compare how far the pins of a preset and of the real sensor move under the same plate presses.

    python benchmarks/preset_motion.py DIR SENSOR [--version 2] [--moved 1] [--fitted]

DIR is model_surface2d of a Tac-VGNN set with as many pins as SENSOR (tactip-127, tactip-331) has.
A calibration that ships turns the labels into indentation and tilt; the preset is pressed by its
own plate, as deep and as tilted, on its own dome, without friction and without noise. The presses
are those of the blocks of tilt and depth that no fit saw, moved sideways by less than --moved mm
(--fitted: those of the fit, which are no test).

Gain is <real, sim> / <sim, sim> over all pins, the factor by which the real pins move farther; its
median over the presses of a band of indentation is printed. Relative is ||sim - real|| / ||real||,
likewise. It takes half a minute.
"""

from __future__ import annotations

import argparse
import math
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench_sim.real.calibration import calibration
from tactibench_sim.real.comparison import DEPTHS, checkerboard
from tactibench_sim.real.plate import indentation
from tactibench_sim.real.recording import Presses, read
from tactibench_sim.sensor import SimulatedTacTip, TacTip127, TacTip331

Array = npt.NDArray[np.float64]
SENSORS: dict[str, type[SimulatedTacTip]] = {"tactip-127": TacTip127, "tactip-331": TacTip331}
PLATE = Indenter.plate()


def places(sensor: SimulatedTacTip, scenes: list[Scene]) -> Array:
    """Return the (S, P, 2) places of the pins in the frames of S scenes, px."""
    x, y, _ = sensor.renderer.project(sensor.points(scenes))
    return np.stack([x, y], axis=-1)


def pairs(ours: Array, real: Array) -> npt.NDArray[np.intp]:
    """Return the (P,) rows of our places (P, 2) that match the real ones (P, 2), both centred."""
    apart = real[:, None] - real.mean(axis=0) - (ours - ours.mean(axis=0))
    return np.asarray(linear_sum_assignment((apart**2).sum(axis=-1))[1])


def roll_deg(ours: Array, real: Array) -> float:
    """Return the turn of the real places (P, 2) against ours (P, 2), deg."""
    ours, real, turned = ours - ours.mean(axis=0), real - real.mean(axis=0), 0.0
    for _ in range(4):  # a better turn pairs more pins rightly
        c, s = math.cos(turned), math.sin(turned)
        mine = ours @ np.array([[c, s], [-s, c]])
        paired = mine[pairs(mine, real)]
        across = paired[:, 0] * real[:, 1] - paired[:, 1] * real[:, 0]
        turned += math.atan2(across.sum(), (paired * real).sum())
    return math.degrees(turned)


def motion(sensor: SimulatedTacTip, presses: Presses, name: str) -> tuple[Array, Array]:
    """Return the (S,) indentation of presses, mm, and the (S, P, 2) motion of a preset's pins, px.

    The pins are in the order of the real ones: paired by least distance at rest, both centred.

    Args:
        sensor: Sensor of the preset, whose camera is turned as the real one.
        presses: Real presses.
        name: Name of the calibration.
    """
    x = calibration(name).unknowns
    depth, tilt = indentation(x, presses.labels), presses.labels.tilt + x.tilt_offset_deg
    rest = places(sensor, [Scene(PLATE, Pose())])
    order = pairs(rest[0], presses.rest)
    yaw = x.yaw_deg - sensor.optics.roll_deg
    scenes = [
        Scene(PLATE, Pose(yaw=yaw, tilt=float(t), depth=max(float(d), 0.0)))
        for t, d in zip(tilt, depth, strict=True)
    ]
    return depth, (places(sensor, scenes) - rest)[:, order]


def gain(sim: Array, real: Array) -> Array:
    """Return the (S,) factor by which real pins (S, P, 2) move farther than simulated ones."""
    seen = np.isfinite(real)
    out: Array = np.sum(sim * real, axis=(1, 2), where=seen) / np.sum(
        sim**2, axis=(1, 2), where=seen
    )
    return out


def main() -> None:
    """Print a line for each band of indentation."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("sensor", choices=sorted(SENSORS))
    parser.add_argument("--version", type=int, default=2)
    parser.add_argument("--moved", type=float, default=1.0)
    parser.add_argument("--fitted", action="store_true")
    given = parser.parse_args()
    name = given.sensor.removeprefix("tactip-")
    presses = read(given.folder, 1)
    context = SensorContext(np.random.SeedSequence(0))
    make = partial(SENSORS[given.sensor], context, version=given.version, size=presses.side)
    sensor = make(roll=roll_deg(places(make(), [Scene(PLATE, Pose())])[0], presses.rest))
    if given.fitted:
        chosen = np.isin(presses.names, calibration(name).frames)
    else:
        chosen = ~checkerboard(presses.labels)[0]
    presses = presses.take(np.flatnonzero(chosen & (abs(presses.labels.move) < given.moved)))
    depth, sim = motion(sensor, presses, name)
    farther, off = gain(sim, presses.moved), np.nansum((sim - presses.moved) ** 2, axis=(1, 2))
    relative = np.sqrt(off / np.nansum(presses.moved**2, axis=(1, 2)))
    print(f"{given.sensor}, version {given.version}\nindentation, mm     n  gain  relative")
    for low, high in pairwise(DEPTHS):
        rows = (depth >= low) & (depth < high)
        cells = "     -         -"
        if rows.any():
            cells = f"{np.median(farther[rows]):6.3f}  {np.median(relative[rows]):8.3f}"
        print(f"{low:g}-{high:g} {rows.sum():16d} {cells}")


if __name__ == "__main__":
    main()
