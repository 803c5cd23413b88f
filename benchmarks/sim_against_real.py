"""Measure how each physical effect improves the simulator's likeness to real plate presses.

    python benchmarks/sim_against_real.py DIR [--fit 200] [--seed 0] [--without]

DIR is model_surface2d of a Tac-VGNN set. Effects are added one after the other, each time with all
unknowns so far fitted again on the same presses. With --without each effect is removed from the
complete model instead. Presses of one colour of a checkerboard of tilt and depth are fitted, those
of the other are held out. The columns are: number of fitted unknowns; then the median over the
held-out presses of ||sim - real|| / ||real||, and the mean distance of simulated and real pins, px,
both from the labels alone and where the frame decides whether the plate dragged the skin. It takes
minutes on one core.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactibench_sim.real.calibration import WITHOUT, Unknowns
from tactibench_sim.real.comparison import checkerboard, errors_of
from tactibench_sim.real.fit import ALL, fit, initial_unknowns, rig_of
from tactibench_sim.real.recording import Presses, read

LABEL = ("depth_offset_mm", "yaw_deg")
PIVOT = ("pivot_mm", "pivot_side_mm", "tilt_offset_deg")
PLACE = ("focal_px", "air_mm", "centre_x", "centre_y")
DRAG = ("drag_per_mm",)
REST = ("drag_per_deg", "drag_offset_mm", "drag_per_depth", "drag_per_tilt")
SLIP = ("slip_mm", "slip_power")
GIVE = ("give_per_mm",)
DRIFT = ("rest_x", "rest_y")


def line(
    name: str,
    first: Presses,
    others: Presses,
    begin: Unknowns,
    free: tuple[str, ...],
    steps: int,
    kind: str = "50_stick",
    lens: str = "fisheye",
    index: float = 1.41,
    *,
    states: bool = True,
) -> Unknowns:
    began = time.perf_counter()
    x, _ = fit(first, rig_of(first, kind, lens, index), begin, free, states=states, steps=steps)
    rig = rig_of(others, kind, lens, index)
    cells = ""
    for state_known in (False, True):
        result = errors_of(others, rig, x, state_known=state_known)
        apart = np.nanmean(np.linalg.norm(result.sim - result.real, axis=-1))
        cells += f" {np.median(result.relative):7.3f} {apart:6.2f}"
    print(f"{name:46s} {len(free):3d}{cells} {time.perf_counter() - began:6.0f} s", flush=True)
    return x


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fit", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--without", action="store_true")
    parser.add_argument("--steps", type=int, default=15)
    given = parser.parse_args()
    presses = read(given.folder, given.fit)
    colour, _ = checkerboard(presses.labels)
    order = np.random.default_rng(given.seed).permutation(np.flatnonzero(colour))
    two = presses.take(order[: given.fit]), presses.take(np.flatnonzero(~colour))
    print(f"{len(two[0])} fitted, {len(two[1])} held out")
    print(f"{'':46s}   n    labels alone    state known")
    begin, steps = initial_unknowns(two[0]), given.steps
    still = {**dict.fromkeys((*DRAG, *REST), 0.0), **WITHOUT}
    if given.without:
        complete = line("whole", *two, begin, ALL, 30, "10_stick")
        for name, gone in (
            ("drag", (*DRAG, *REST)),
            ("turn, offsets", REST),
            ("pivot", PIVOT),
            ("slip", SLIP),
            ("a base that gives way", GIVE),
            ("drift of the rest frame", DRIFT),
        ):
            zero = replace(complete, **{name: WITHOUT.get(name, 0.0) for name in gone})
            if gone is PIVOT:
                zero = replace(zero, pivot_mm=20.0)
            line(f"without {name}", *two, zero, tuple(n for n in ALL if n not in gone), steps)
        line("frictionless press", *two, complete, ALL, steps, "50_none")
        line(
            "without refraction",
            *two,
            replace(complete, gel_mm=20.0, pin_length_mm=0.0),
            tuple(n for n in ALL if n != "gel_mm"),
            steps,
            index=1.0,
        )
        other = replace(complete, air_mm=10.0, gel_mm=15.0, focal_px=95.0)
        line("pinhole with refraction", *two, other, ALL, steps, lens="pinhole")
        for length in (0.0, 1.0, 2.0):
            line(
                f"pin length {length:g} mm",
                *two,
                replace(complete, pin_length_mm=length),
                tuple(n for n in ALL if n != "pin_length_mm"),
                steps,
            )
        for kind in ("50_stick", "300_stick"):
            line(f"dome {kind}", *two, complete, ALL, steps, kind)
        line("fitted as if every press was dragged", *two, complete, ALL, steps, states=False)
        return
    pinhole: dict[str, Any] = {"kind": "50_none", "lens": "pinhole", "index": 1.0}
    bare = replace(begin, air_mm=35.0, gel_mm=20.0, focal_px=370.6, pin_length_mm=1.5, **still)
    bare = replace(bare, pivot_mm=0.0)
    free: tuple[str, ...] = (*LABEL, "pin_length_mm")
    x = line("bare pinhole 55 mm off, three scalars", *two, bare, free, steps, **pinhole)
    free = (*free, *PIVOT)
    x = replace(x, pivot_mm=15.0)
    x = line("+ pivot, tilt offset", *two, x, free, steps, **pinhole)
    free = (*free, *PLACE)
    x = replace(x, air_mm=5.0, focal_px=180.0)
    x = line("+ camera's place and focal length", *two, x, free, steps, **pinhole)
    x = replace(x, air_mm=2.0, focal_px=140.0, pin_length_mm=0.0)
    x = line("+ fisheye", *two, x, free, steps, "50_none", "fisheye", 1.0)
    free = (*free, "gel_mm")
    x = replace(x, air_mm=begin.air_mm, gel_mm=begin.gel_mm, focal_px=begin.focal_px)
    x = line("+ refraction", *two, replace(x, pin_length_mm=0.5), free, steps, "50_none")
    x = line("+ sticking press", *two, x, free, steps)
    free = (*free, *DRAG)
    x = line("+ drag by the labelled move", *two, replace(x, drag_per_mm=-0.5), free, steps)
    free = (*free, *REST)
    x = line("+ turn, drag by depth and tilt", *two, x, free, steps)
    free = (*free, *SLIP)
    x = line("+ slip", *two, replace(x, slip_mm=0.35, slip_power=1.0), free, steps)
    free = (*free, *GIVE)
    x = line("+ a base that gives way", *two, replace(x, give_per_mm=0.03), free, steps)
    free = (*free, *DRIFT)
    x = line("+ drift of the rest frame", *two, x, free, steps)
    line("+ stiffness ratio 10 instead of 50", *two, x, free, steps, "10_stick")


if __name__ == "__main__":
    main()
