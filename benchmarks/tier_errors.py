"""Compare the simulator with the finite-element scenes that ship, and time it.

    PYTHONPATH=.:plugins python -P benchmarks/tier_errors.py [--picture PNG]

Printed for every run: the largest distance of the tip of a pin of either sensor from finite
elements, mm, in tiers ``coupled`` and ``superpose``, with the median in brackets; then the stated
bound of tier ``coupled``, and by how much its field misses the depth of a tip. Then the same by
number of tips. Then every scene that was computed with friction: the largest and the median
distance of the base of a pin, in frames with friction and in those without. The last lines are
microseconds of one thread for the field of a scene with two tips.

--picture draws error against depth with and without friction.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from tactibench import SensorContext
from tactibench_sim import (
    FrictionMechanics,
    ReferenceScene,
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

Array = npt.NDArray[np.float64]
TIERS = ("coupled", "superpose")
KINDS = ("", "single", "pairs", "triples")
DEPTHS_MM = (3, 6)
BATCH, REPEATS = 64, 20
DRAWN = {
    "rub_single8": ("one tip 8 mm off the apex", "tab:blue"),
    "rub_unequal": ("two tips 9 mm apart", "tab:orange"),
    "rub_triple": ("three tips 8 mm apart", "tab:green"),
}
"""Name and colour of the runs of the picture."""


class Compared(NamedTuple):
    """A scene and its distances from finite elements.

    Attributes:
        scene: The scene.
        off: Of each tier: (P,) distances of the tips of the pins of both sensors, mm.
        bases: (2, P) distances of the bases with and without friction, mm.
        bound: Stated bound of a pin's tip, mm.
        missed: By how much the field misses the depth of a tip, mm.
    """

    scene: ReferenceScene
    off: dict[str, Array]
    bases: Array
    bound: float
    missed: float


def compare(scene: ReferenceScene, tiers: dict[str, TableMechanics]) -> Compared:
    """Return how far a scene is from finite elements."""
    context = SensorContext(np.random.SeedSequence(0))
    sensors = [kind(context) for kind in (TacTip127, TacTip331)]
    tips, off = scene.as_tips, {}
    models: dict[str, Any] = {
        tier: FrictionMechanics(plain, scene.friction) if scene.friction else plain
        for tier, plain in tiers.items()
    }
    for tier, model in models.items():
        loads, each = model.loads(tips), []
        for sensor in sensors:
            seen = model.pin_tips(loads, sensor.directions, sensor.pin_length)[0]
            each.append(np.linalg.norm(seen - reference_tips(sensor, scene), axis=1))
        off[tier] = np.concatenate(each)
    bases = [
        np.linalg.norm(
            model.displacement(model.loads(tips), scene.directions)[0][0] - scene.displacement,
            axis=1,
        )
        for model in (models["coupled"], tiers["coupled"])
    ]
    bound = shipped_bounds().bound(tips, max(sensor.pin_length for sensor in sensors))[0]
    missed = missed_depths(models["coupled"], tips)[0]
    return Compared(scene, off, np.array(bases), bound, missed)


def print_runs(cases: list[Compared]) -> None:
    """Print both tiers by run, and by number of tips and depth."""
    runs, kinds = defaultdict(list), defaultdict(list)
    for case in cases:
        runs[case.scene.name].append(case)
        kind = KINDS[len(case.scene.tips)] + (", friction" if case.scene.friction else "")
        for depth in DEPTHS_MM:
            if case.scene.as_tips.directions()[1].max() < depth + 0.1:
                kinds[f"{kind}, to {depth} mm"].append(case)
    print(f"{'':28}" + "".join(f"{tier:>18}" for tier in TIERS) + "    bound   missed")
    for name, some in {**runs, **dict(sorted(kinds.items()))}.items():
        off = [np.concatenate([case.off[tier] for case in some]) for tier in TIERS]
        errors = "".join(f"{each.max():10.3f} ({np.median(each):.3f})" for each in off)
        most = max(case.bound for case in some), max(case.missed for case in some)
        print(f"{name:28}{errors}" + "".join(f"{each:9.3f}" for each in most))


def print_friction(cases: list[Compared]) -> None:
    """Print each scene with friction, at the bases of the pins."""
    print(f"\n{'bases of pins, mm':28}    mu    with friction without friction")
    for case in cases:
        errors = "".join(f"{each.max():10.3f} ({np.median(each):.3f})" for each in case.bases)
        print(f"{case.scene.label:28}{case.scene.friction:6g}{errors}")


def draw(cases: list[Compared], path: Path) -> None:
    """Draw the largest error of a base against depth, with and without friction."""
    figure = Figure(figsize=(6.4, 3.6), dpi=120, layout="constrained")
    axes = figure.subplots()
    for name, (label, colour) in DRAWN.items():
        some = [case for case in cases if case.scene.name == name]
        depth = [case.scene.depth for case in some]
        most = np.array([case.bases.max(axis=1) for case in some])
        for error, style, fill in zip(most.T, ("o-", "o--"), (colour, "white"), strict=True):
            axes.plot(depth, error, style, color=colour, markerfacecolor=fill)
        axes.plot([], [], "o-", color=colour, label=f"{label}, friction {some[0].scene.friction:g}")
    axes.plot([], [], "ko--", markerfacecolor="white", label="the same, frames without friction")
    axes.set(yscale="log", xlabel="depth, mm", ylabel="largest error of a pin's base, mm")
    axes.set_ylim(0.01, 1.0)
    axes.set_yticks([0.01, 0.03, 0.1, 0.3, 1], ["0.01", "0.03", "0.1", "0.3", "1"])
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    figure.savefig(path)


def print_times(tiers: dict[str, TableMechanics]) -> None:
    """Print the time that a scene of two tips takes."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(-2, 2, (BATCH, 1, 2)) + np.array([[-3.5, 0.0], [3.5, 0.0]])
    tips = Tips(xy, rng.uniform(0.5, 4, (BATCH, 2)), np.full(BATCH, 3.0))
    rubbing = {"with friction": FrictionMechanics(tiers["coupled"], 0.5)}
    each: dict[str, Any] = {**tiers, **rubbing}
    for name, mechanics in each.items():
        times = []
        for _ in range(REPEATS):
            begun = time.perf_counter()
            mechanics.displacement(mechanics.loads(tips), layout(127))
            times.append(time.perf_counter() - begun)
        print(f"{name}: {1e6 * min(times) / BATCH:.0f} us a scene")


def main() -> None:
    """Print errors and times, and draw the picture if asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", type=Path, metavar="PNG")
    given = parser.parse_args()
    tables = shipped_dome()
    tiers = {tier: TableMechanics(tables, tier, other_tips=True) for tier in TIERS}
    cases = [compare(scene, tiers) for scene in reference_scenes()]
    rubbed = [case for case in cases if case.scene.friction]
    print_runs(cases)
    print_friction(rubbed)
    if given.picture:
        draw(rubbed, given.picture)
    print_times(tiers)


if __name__ == "__main__":
    main()
