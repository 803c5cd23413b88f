#!/usr/bin/env python3
"""Test models that trained in regime `multiple` on geometries that no training pressed.

    python benchmarks/held_out_geometry.py superpose unet

Trains every model on `exp2`, or takes it from the cache: once on single presses, once also on the
pairs and triangles of regime `multiple`. Both predict the same presses. The pairs of the training
are level and its triangles have sides of 8 mm; the other geometries differ. Prints the mean OSPA of
both, and the mean difference, press by press, with its 95 % interval: above 0, regime `multiple` is
worse. Presses come from a seed of their own.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from rich.console import Console

from tactibench.contacts import Contacts, FloatArray, Indenter, Pose, Scene
from tactibench.geometry import true_contacts
from tactibench.metrics import Trials, ospa
from tactibench.plugins import PluginHost, SensorContext
from tactibench.protocols import PATIENCE, Workspace, fits, load_protocol
from tactibench.records import cache_folder
from tactibench.report import Column, print_table, table
from tactibench.run import NullReporter, RunRequest, make_plan, train_model
from tactibench.stats import mean_interval
from tactibench.sweep import read_choice

PROTOCOL = "exp2"
RADIUS_MM = 3.0
NEAR, FAR = 6.5, 12.0
"""Least and largest distance between tips, mm, as in the protocol's pairs."""

Draw = Callable[[np.random.Generator], Indenter]


def _pair(rng: np.random.Generator, steps: tuple[float, float]) -> Indenter:
    half, step = rng.uniform(NEAR, FAR) / 2, rng.uniform(*steps)
    return Indenter(RADIUS_MM, ((-half, 0.0, 0.0), (half, 0.0, step)), "pair")


def _triangle(rng: np.random.Generator) -> Indenter:
    low, middle, high = rng.uniform(0, 3, 3)
    return Indenter.triple((low, middle, high), 8.0, RADIUS_MM)


def _row(rng: np.random.Generator) -> Indenter:
    left, right = rng.uniform(NEAR, 8.5, 2)
    heights = rng.uniform(0, 2, 3)
    xs = (-left, 0.0, right)
    return Indenter(RADIUS_MM, tuple((x, 0.0, h) for x, h in zip(xs, heights, strict=True)), "row")


def _crooked(rng: np.random.Generator) -> Indenter:
    """Return three tips at random places, at least as far apart as the nearest pairs."""
    while True:
        xy = rng.uniform(-6, 6, (3, 2))
        sides = np.linalg.norm(xy - np.roll(xy, 1, axis=0), axis=1)
        if sides.min() >= NEAR:
            break
    heights = rng.uniform(0, 2, 3)
    return Indenter(
        RADIUS_MM, tuple((x, y, h) for (x, y), h in zip(xy, heights, strict=True)), "crooked"
    )


GEOMETRIES: dict[str, Draw] = {
    "one tip": lambda _rng: Indenter.single(RADIUS_MM),
    "level pair (trained)": lambda rng: _pair(rng, (0.0, 0.0)),
    "uneven pair, 0.5 to 3 mm": lambda rng: _pair(rng, (0.5, 3.0)),
    "triangle of 8 mm (trained)": _triangle,
    "crooked triangle": _crooked,
    "three in a row": _row,
}


def main() -> None:
    """Print a table for each model."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="+", help='such as superpose or "unet, epochs=15"')
    parser.add_argument("--presses", type=int, default=200, help="of each geometry")
    parser.add_argument("--seed", type=int, default=0, help="of the trainings")
    parser.add_argument("--draw", type=int, default=1, help="seed of the presses")
    options = parser.parse_args()
    console, host = Console(), PluginHost()
    spec = load_protocol(PROTOCOL).spec
    sensor_spec = host.sensors[spec.defaults.sensor]
    with sensor_spec.build(
        SensorContext(np.random.SeedSequence(options.draw)), **sensor_spec.settings({})
    ) as sensor:
        tests = {}
        for number, (name, draw) in enumerate(GEOMETRIES.items()):
            rng = np.random.default_rng([options.draw, number])
            scenes = list(_scenes(draw, spec.workspace, options.presses, rng))
            tests[name] = (
                list(sensor.press_many(scenes)),
                [true_contacts(scene) for scene in scenes],
            )
    for text in options.models:
        choice = read_choice(text)
        models = [
            train_model(
                make_plan(
                    RunRequest(
                        PROTOCOL,
                        choice.name,
                        regime=regime,
                        seed=options.seed,
                        parameters={"model": choice.parameters},
                    ),
                    host,
                    cache_folder(),
                ),
                NullReporter(),
            )[0]
            for regime in ("single", "multiple")
        ]
        rows = []
        for name, (frames, truth) in tests.items():
            single, multiple = (
                _values(model.predict(frames), truth, spec.test.gate_mm) for model in models
            )
            worse = mean_interval(multiple - single, np.arange(len(truth)))
            rows.append(
                [
                    name,
                    f"{single.mean():.3f}",
                    f"{multiple.mean():.3f}",
                    f"{worse.value:+.3f} [{worse.low:+.3f}, {worse.high:+.3f}]",
                ]
            )
        heads = (
            Column("pressed with", right=False),
            Column("single, mm"),
            Column("multiple, mm"),
            Column("multiple - single [95 %]"),
        )
        print_table(console, table(heads, rows, title=f"{text}: OSPA, {options.presses} presses"))


def _scenes(
    draw: Draw, workspace: Workspace, count: int, rng: np.random.Generator
) -> Iterator[Scene]:
    """Yield presses that lie in the workspace.

    Raises:
        RuntimeError: The workspace has no room for a press of this geometry.
    """
    half = workspace.half_width_mm
    for _ in range(count):
        for _ in range(PATIENCE):
            x, y = rng.uniform(-half, half, 2)
            depth = rng.uniform(workspace.depth_min_mm, workspace.depth_max_mm)
            scene = Scene(draw(rng), Pose(x, y, rng.uniform(0, 360), 0.0, depth))
            if fits(scene, workspace):
                yield scene
                break
        else:
            raise RuntimeError("no press fits the workspace")


def _values(answers: Sequence[Any], truth: Sequence[Contacts], gate: float) -> FloatArray:
    """Return the (N,) OSPA of the answers, mm."""
    predictions, names = tuple(answers), ("all",) * len(truth)
    return ospa(Trials(tuple(truth), predictions, np.arange(len(truth)), names, gate=gate)).values


if __name__ == "__main__":
    main()
