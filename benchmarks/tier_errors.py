"""Compare the tiers of the simulator with the finite-element scenes that ship, and time them.

    PYTHONPATH=.:plugins python -P benchmarks/tier_errors.py

Printed for every family of scenes: the largest distance of a pin base from finite elements, mm, in
tiers ``coupled`` and ``superpose``, with the median in brackets; then the stated bound. The last
lines are microseconds of one thread for the field of a scene with two tips.
"""

from __future__ import annotations

import time
from collections import defaultdict

import numpy as np

from tactibench_sim import (
    TableMechanics,
    Tips,
    layout,
    reference_scenes,
    scene_bounds,
    shipped_dome,
)

TIERS = ("coupled", "superpose")
BATCH, REPEATS = 64, 20


def main() -> None:
    """Print errors and times."""
    tables = shipped_dome()
    tiers = {tier: TableMechanics(tables, tier) for tier in TIERS}
    families = defaultdict(list)
    for scene in reference_scenes():
        row = []
        for tier, mechanics in tiers.items():
            u, _ = mechanics.displacement(mechanics.loads(scene.as_tips), scene.directions)
            off = np.linalg.norm(u[0] - scene.displacement, axis=1)
            bound = scene_bounds(tier, tables.digest, scene.as_tips)[0]
            row.append((off.max(), np.median(off), bound))
        families[scene.name].append(row)
    print(f"{'run':14}" + "".join(f"{tier:>28}" for tier in TIERS))
    for name, rows in families.items():
        worst = np.max(rows, axis=0)
        cells = "".join(f"{a:14.3f} ({b:.3f}) <= {c:.3f}" for a, b, c in worst)
        print(f"{name:14}{cells}")
    rng = np.random.default_rng(0)
    xy = rng.uniform(-2, 2, (BATCH, 1, 2)) + np.array([[-3.5, 0.0], [3.5, 0.0]])
    tips = Tips(xy, rng.uniform(0.5, 4, (BATCH, 2)), np.full(BATCH, 3.0))
    for tier, mechanics in tiers.items():
        times = []
        for _ in range(REPEATS):
            begun = time.perf_counter()
            mechanics.displacement(mechanics.loads(tips), layout(127))
            times.append(time.perf_counter() - begun)
        print(f"{tier}: {1e6 * min(times) / BATCH:.0f} us a scene")


if __name__ == "__main__":
    main()
