"""Compare the tiers of the simulator with the finite-element scenes that ship, and time them.

    PYTHONPATH=.:plugins python -P benchmarks/tier_errors.py

Printed for every run: the largest distance of the tip of a pin of either sensor from finite
elements, mm, in tiers ``coupled`` and ``superpose``, with the median in brackets; then the stated
bound of tier ``coupled``, and by how much its field misses the depth of a tip. The last lines are
microseconds of one thread for the field of a scene with two tips.
"""

from __future__ import annotations

import time
from collections import defaultdict

import numpy as np

from tactibench import SensorContext
from tactibench_sim import (
    FrictionMechanics,
    TableMechanics,
    TacTip127,
    TacTip331,
    Tips,
    layout,
    missed_depths,
    reference_scenes,
    reference_tips,
    shipped_bounds,
    shipped_dome,
)

TIERS = ("coupled", "superpose")
BATCH, REPEATS = 64, 20


def main() -> None:
    """Print errors and times."""
    tables = shipped_dome()
    tiers = {tier: TableMechanics(tables, tier) for tier in TIERS}
    context = SensorContext(np.random.SeedSequence(0))
    sensors = [kind(context) for kind in (TacTip127, TacTip331)]
    runs = defaultdict(list)
    for scene in reference_scenes():
        tips, row = scene.as_tips, []
        for plain in tiers.values():
            model = FrictionMechanics(plain, scene.friction) if scene.friction else plain
            off = []
            for sensor in sensors:
                seen = model.pin_tips(model.loads(tips), sensor.directions, sensor.pin_length)[0]
                off.append(np.linalg.norm(seen - reference_tips(sensor, scene), axis=1))
            row += [max(each.max() for each in off), np.median(np.concatenate(off))]
        model = FrictionMechanics(tiers["coupled"], scene.friction or 1.0)
        length = max(sensor.pin_length for sensor in sensors)
        bound = shipped_bounds().bound(tips, length)[0]
        missed = missed_depths(model if scene.friction else tiers["coupled"], tips)[0]
        runs[scene.name].append((*row, bound, missed))
    print(f"{'run':14}" + "".join(f"{tier:>18}" for tier in TIERS) + "    bound   missed")
    for name, rows in runs.items():
        a, b, c, d, bound, missed = np.max(rows, axis=0)
        print(f"{name:14}{a:10.3f} ({b:.3f}){c:10.3f} ({d:.3f}){bound:9.3f}{missed:9.3f}")
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
