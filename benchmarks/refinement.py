#!/usr/bin/env python3
"""Test models, and their refinement, on presses of every coefficient of friction.

    python benchmarks/refinement.py --picture docs/images/refinement.png

Trains superpose and unet with refine=fields on single presses of `exp1`, or takes them from the
cache. Single presses and pairs of 6.5 to 12 mm come from a seed of their own, with one coefficient
each; the training saw coefficients around 0.5 and was told none. Prints the mean of the errors of
x, y and depth, the share of pairs that are seen as two, and the error of their distance. The
picture shows both errors, and a pair as unet sees it.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from tactibench.contacts import Contacts, Frame, Indenter, Pose, Scene
from tactibench.geometry import true_contacts
from tactibench.plugins import PluginHost, SensorContext
from tactibench.protocols import fits, load_protocol
from tactibench.records import cache_folder
from tactibench.report import Column, print_table, table
from tactibench.run import NullReporter, RunRequest, make_plan, train_model
from tactibench.training import RefinedModel

FRICTIONS = (0.0, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0)
COLOURS = {"unet": "#d95f02", "unet, refined": "#1b9e77", "superpose": "#7570b3"}
Labelled = tuple[list[Frame], list[Contacts]]


def main() -> None:
    """Print the table, and draw the picture if asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--presses", type=int, default=100, help="of each kind and coefficient")
    parser.add_argument("--picture", type=Path, metavar="PNG")
    given = parser.parse_args()
    host = PluginHost()
    refined, superpose = _trained("unet", host), _trained("superpose", host)
    assert isinstance(refined, RefinedModel)  # noqa: S101 - it was asked for
    models = {"unet": refined.model, "unet, refined": refined, "superpose": superpose}
    errors: dict[str, list[tuple[float, float]]] = {name: [] for name in models}
    rows = []
    for friction in FRICTIONS:
        singles, pairs = (_press(host, friction, given.presses, tips) for tips in (1, 2))
        line: list[Any] = [f"{friction:g}"]
        for name, model in models.items():
            one = _single_error(_predicted(model, singles[0]), singles[1])
            seen, apart = _pair_error(_predicted(model, pairs[0]), pairs[1])
            errors[name].append((one, apart))
            line.append(f"{one:.4f}, {100 * seen:.0f} %, {apart:.3f}")
        rows.append(line)
    heads = (Column("friction", right=False), *(Column(name) for name in models))
    title = "mean error of one contact, mm; pairs seen as two; error of their distance, mm"
    print_table(Console(), table(heads, rows, title=title))
    if given.picture:
        _draw(errors, refined, _press(host, 0.5, 8, 2), given.picture)


def _trained(name: str, host: PluginHost) -> Any:
    parameters = {"model": {"refine": "fields"}} if name == "unet" else {}
    request = RunRequest("exp1", name, parameters=parameters)
    return train_model(make_plan(request, host, cache_folder()), NullReporter())[0]


def _press(host: PluginHost, friction: float, count: int, tips: int) -> Labelled:
    """Return frames and contacts of presses with one coefficient of friction."""
    workspace = load_protocol("exp1").spec.workspace
    rng = np.random.default_rng((77, round(100 * friction), tips))
    scenes: list[Scene] = []
    while len(scenes) < count:
        tip = Indenter.single() if tips == 1 else Indenter.dual(float(rng.uniform(6.5, 12.0)))
        x, y, yaw, depth = rng.uniform((-6.4, -6.4, 0, 0.5), (6.4, 6.4, 360, 6))
        scene = Scene(tip, Pose(x, y, yaw, 0, depth))
        if fits(scene, workspace) and len(true_contacts(scene)) == tips:
            scenes.append(scene)
    spec = host.sensors["tactip-127"]
    values = spec.settings({"friction": str(friction), "friction_within": "0"})
    with spec.build(SensorContext(np.random.SeedSequence(78)), **values) as sensor:
        return list(sensor.press_many(scenes)), [true_contacts(scene) for scene in scenes]


def _predicted(model: Any, frames: Sequence[Frame]) -> list[Any]:
    return [model.predict([frame])[0] for frame in frames]


def _single_error(answers: Sequence[Any], truth: Sequence[Contacts]) -> float:
    """Return the mean error of x, y and depth of the contacts with the highest score, mm."""
    off = [
        np.abs([*(best.xy - true.xy)[0], (best.depth - true.depth)[0]])
        for best, true in ((each.top(1), true) for each, true in zip(answers, truth, strict=True))
        if len(best)
    ]
    return float(np.mean(off))


def _pair_error(answers: Sequence[Any], truth: Sequence[Contacts]) -> tuple[float, float]:
    """Return the share of pairs seen as two, and the mean error of their distance, mm."""
    off = [
        abs(_distance(each) - _distance(true))
        for each, true in zip(answers, truth, strict=True)
        if len(each) == 2
    ]
    return len(off) / len(truth), float(np.mean(off))


def _distance(pair: Contacts) -> float:
    return float(np.linalg.norm(pair.xy[0] - pair.xy[1]))


def _draw(
    errors: dict[str, list[tuple[float, float]]], refined: Any, pairs: Labelled, path: Path
) -> None:
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    one, two, map_axes = figure.subplots(1, 3)
    for name, values in errors.items():
        for axes, part in ((one, 0), (two, 1)):
            drawn = [value[part] for value in values]
            axes.plot(FRICTIONS, drawn, "o-", color=COLOURS[name], label=name)
    for axes, title in ((one, "one contact: error"), (two, "two contacts: error of distance")):
        axes.set(xlabel="coefficient of friction", ylabel="mm", title=title, ylim=(0, None))
        axes.grid(alpha=0.3)
    one.legend(frameon=False)
    frames, truth = pairs
    before = _predicted(refined.model, frames)
    gap = [
        abs(_distance(each) - _distance(true)) if len(each) == 2 else 0.0
        for each, true in zip(before, truth, strict=True)
    ]
    row = int(np.argmax(gap))  # where refinement has most to do
    axis = load_protocol("exp1").spec.grid.grid().axes()[0]
    extent = (axis[0], axis[-1], axis[-1], axis[0])
    map_axes.imshow(refined.model.maps([frames[row]])[0, 0], cmap="Greys", extent=extent)
    after = refined.predict([frames[row]])[0]
    for shown, mark, colour, label in (
        (truth[row], "+", "black", "truth"),
        (before[row], "o", COLOURS["unet"], "unet"),
        (after, "x", COLOURS["unet, refined"], "refined"),
    ):
        fill = {"markerfacecolor": "none"} if mark == "o" else {}
        map_axes.plot(*shown.xy.T, mark, color=colour, markersize=10, label=label, **fill)
    map_axes.set(xlabel="x, mm", ylabel="y, mm", title="a pair, and the map of unet")
    map_axes.set(xlim=(-9, 9), ylim=(9, -9))
    map_axes.legend(loc="upper right")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
