"""Print the Cramer-Rao bounds of exp1 with the coefficient of friction known and unknown.

    PYTHONPATH=.:plugins python -P benchmarks/cramer_rao.py [--presses 400]

Medians over test presses of exp1 on tactip-127: standard deviations of x, y and depth, um, and of
the coefficient. tests/sim/test_sim_bounds_sensor.py reaches the bound by least squares.
"""

from __future__ import annotations

import argparse

import numpy as np

from tactibench import SensorContext
from tactibench.protocols import draw_scenes, protocol_files, read_protocol, split_presses
from tactibench_sim import TacTip127, information, inverse, marginal


def main() -> None:
    """Print the bounds."""
    parser = argparse.ArgumentParser(description="Cramer-Rao bounds of exp1.")
    parser.add_argument("--presses", type=int, default=400)
    given = parser.parse_args()
    spec = read_protocol(protocol_files()["exp1"]).spec
    scenes = draw_scenes(spec, "singles").scenes
    assert spec.split is not None  # noqa: S101 - exp1 has one
    test = split_presses(len(scenes), spec.split, spec.data_seed).test[: given.presses]
    sensor = TacTip127(SensorContext(np.random.SeedSequence(0)))
    rows = []
    for press in test:
        tips = sensor.indenter_tips([scenes[press]])
        every = information(tips, sensor.clean, sensor.renderer.variance, ("friction",))
        known, unknown = inverse(every[:3, :3]), inverse(marginal(every, 4))
        rows.append(np.sqrt([*np.diag(known), *np.diag(unknown)]))
    median = np.median(rows, axis=0)
    x, y, depth = median[:3]
    print(f"{len(rows)} presses, friction {sensor.friction:g}")
    print(f"known:   x {1e3 * x:.2f}, y {1e3 * y:.2f}, depth {1e3 * depth:.2f} um")
    x, y, depth, friction = median[3:]
    print(
        f"unknown: x {1e3 * x:.2f}, y {1e3 * y:.2f}, depth {1e3 * depth:.2f} um, "
        f"coefficient {friction:.4f}"
    )


if __name__ == "__main__":
    main()
