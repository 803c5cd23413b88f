"""Error and speed of the tier green on one core.

    PYTHONPATH=.:plugins python -P benchmarks/green.py [--pair FILE SPACING]

Prints the pin-base error of single contacts against the finite-element tables, for the linear
kernel and with its softening under load, and the time of a dual scene. --pair: an npz of a 3-D
finite-element run of two R = 3 spheres (b directions, u displacement, d depths) to compare with.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactibench_sim.green import kernel as kernels
from tactibench_sim.green.mechanics import GreenMechanics
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.tables import shipped
from tactibench_sim.pins import layout

DEPTHS = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0)


def tips(contacts: list[tuple[float, float, float]], radius: float) -> Tips:
    array = np.array([contacts])
    return Tips(array[..., :2], array[..., 2], np.array([radius]))


def single(models: dict[str, GreenMechanics]) -> None:
    tables = shipped()
    polar = next(iter(tables.by_radius.values())).polar[:140]
    at = np.stack([np.sin(polar), 0 * polar, np.cos(polar)], axis=1)
    along = np.stack([np.cos(polar), 0 * polar, -np.sin(polar)], axis=1)
    print("single contact: pin-base error, max / median mm over 0..70 deg; force over the table's")
    print(f"{'indenter':10}{'d mm':>6}" + "".join(f"{name:>28}" for name in models))
    for radius, table in tables.by_radius.items():
        for depth in DEPTHS:
            row = round(depth / table.delta[1])
            w, t = (table.fields[q][row, :140, None] for q in "wt")
            cells = []
            for model in models.values():
                loads = model.loads(tips([(0.0, 0.0, depth)], radius))
                u = model.displacement(loads, at)[0][0]
                error = np.linalg.norm(u - (t * along - w * at), axis=1)
                ratio = loads[0].force[0] / table.fields["force"][row]
                cells.append(f"{error.max():10.3f} /{np.median(error):7.4f} {ratio:6.3f}  ")
            print(f"{radius:<10g}{depth:6g}" + "".join(f"{c:>28}" for c in cells))


def pair(models: dict[str, GreenMechanics], file: Path, spacing: float) -> None:
    content = np.load(file)
    print(f"pair of R = 3 spheres {spacing:g} mm apart: pin-base error, max / median mm")
    for depth, u in zip(content["d"], content["u"], strict=True):
        cells = []
        for name, model in models.items():
            scene = tips([(-spacing / 2, 0.0, depth), (spacing / 2, 0.0, depth)], 3.0)
            error = np.linalg.norm(
                model.displacement(model.loads(scene), content["b"])[0][0] - u, axis=1
            )
            cells.append(f"{name} {error.max():.3f} / {np.median(error):.4f}")
        print(f"  d {depth:g}: " + "; ".join(cells))


def speed(model: GreenMechanics, rounds: int) -> None:
    print("dual scene, 7 mm: forces, field of 127 and of 331 pins, ms: minimum (median)")
    for depth in (0.5, 1.0, 2.0, 3.0, 4.0, 6.0):
        scene = tips([(-3.5, 0.3, depth), (3.5, 0.0, 0.9 * depth)], 3.0)
        taken: dict[str, list[float]] = {"forces": [], "127": [], "331": []}
        for _ in range(rounds):
            start = time.perf_counter()
            loads = model.loads(scene)
            taken["forces"].append(time.perf_counter() - start)
            for pins in (127, 331):
                directions = layout(pins)
                start = time.perf_counter()
                model.displacement(loads, directions)
                taken[str(pins)].append(time.perf_counter() - start)
        cells = (f"{k} {1e3 * min(v):.2f} ({1e3 * np.median(v):.2f})" for k, v in taken.items())
        print(f"  d {depth:g}: " + "; ".join(cells))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pair", nargs=2, metavar=("FILE", "SPACING"))
    parser.add_argument("--rounds", type=int, default=100)
    asked = parser.parse_args()
    kernel = kernels.shipped()
    models = {
        "linear": GreenMechanics(replace(kernel, shares=0 * kernel.shares)),
        "softening": GreenMechanics(kernel),
    }
    single(models)
    if asked.pair:
        models["with tables"] = GreenMechanics(kernel, shipped())
        pair(models, Path(asked.pair[0]), float(asked.pair[1]))
    speed(models["softening"], asked.rounds)


if __name__ == "__main__":
    main()
