"""Measure the time from frame to contacts of the U-Net as runs time it, and of plain PyTorch.

    python benchmarks/latency.py [--calls 300] [--width 16] [--threads 1,2]

Plain is the same network in eager float32, with normalisation not folded and contiguous memory, its
maps read with ``skimage.feature.peak_local_max``. Timed is the configuration that a run chooses,
and every other one that works on this machine. All are called in turns in one process, one frame a
call. The weights are random, so that all decode true heatmaps of three contacts instead of the
network's own maps. Times are given by the clock on the wall and, for one thread, as processor time,
on which other work of the machine has less influence.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from skimage.feature import peak_local_max

from tactibench import Contacts, Frame, Grid, ModelContext, Pose
from tactibench.plugins import Stage
from tactibench.run import (
    COMPILED,
    Clocks,
    LatencySample,
    compare_configurations,
    fastest,
    limited_threads,
    time_in_rounds,
)
from tactibench.run.machine import machine
from tactibench_heatmaps.hertz import HertzGaussian
from tactibench_unet.model import UNet

GRID, MAX_DEPTH_MM = Grid.centred(64, 0.4), 6.0
PLAIN = "plain"
NEEDED = {False: 1.5, True: 2.5}
"""Least ratio of the p90 latencies, by whether the processor has matrix units (AMX)."""


def scenes(rng: np.random.Generator, count: int) -> list[Contacts]:
    """Return frames of three contacts 8 mm apart, as the triple indenter makes them."""
    turn = rng.uniform(0, 2 * np.pi, (count, 1)) + np.arange(3) * 2 * np.pi / 3
    xy = 8 / np.sqrt(3) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    depths = rng.uniform(0.5, 6, (count, 3))
    return [Contacts.truth(p, d) for p, d in zip(xy, depths, strict=True)]


def peaks(maps: np.ndarray) -> list[Contacts]:
    """Return the local maxima of each map with their height as depth, as is commonly done."""
    contacts = []
    for heat in maps[:, 0]:
        cells = peak_local_max(heat, min_distance=5, threshold_abs=0.05)
        rows, columns = cells.T
        x, y = GRID.axes()
        depth = MAX_DEPTH_MM * heat[rows, columns]
        contacts.append(
            Contacts(np.column_stack([x[columns], y[rows]]), depth, heat[rows, columns])
        )
    return contacts


def plain(model: UNet) -> list[Stage]:
    forward = dict(model.configured("float32", [blank(np.random.default_rng(0))]))["forward"]
    return [("preprocess", model.inputs), ("forward", forward), ("decode", peaks)]


def blank(rng: np.random.Generator) -> Frame:
    return Frame(rng.integers(0, 256, (128, 128), dtype=np.uint8), 0.0, Pose())


def with_true_maps(stages: Sequence[Stage], maps: np.ndarray) -> list[Stage]:
    """Return the same stages, of which the last one decodes true maps in turn."""
    turns = cycle(maps[:, None])
    *before, (name, decode) = stages
    return [*before, (name, lambda _: decode(next(turns)))]


def show(sample: LatencySample, name: str, against: LatencySample) -> float:
    """Print one line and return the ratio of the p90 latencies."""
    total = sample.total_ms
    p50, p90 = np.quantile(total, (0.5, 0.9))
    ratio = float(np.quantile(against.total_ms, 0.9) / p90)
    phases = zip(sample.phases, np.median(sample.raw_ms, axis=0), strict=True)
    parts = ", ".join(f"{phase} {value:.2f}" for phase, value in phases)
    middle = float(np.median(against.total_ms) / p50)
    print(
        f"  {name:12s} p50 {p50:7.2f} ms, p90 {p90:7.2f} ms ({parts}); plain / this: "
        f"p90 {ratio:.2f}, p50 {middle:.2f}"
    )
    return ratio


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=300)
    parser.add_argument("--width", type=int, default=16)
    parser.add_argument("--threads", default="", help="such as 1,2; default: one and all")
    parser.add_argument("--compile", action="store_true", help="try torch.compile, too")
    options = parser.parse_args()
    facts: dict[str, Any] = machine()
    counts = [int(text) for text in options.threads.split(",") if text]
    counts = counts or sorted({1, int(facts["cores_logical"] or 1)})
    rng = np.random.default_rng(1)
    encoder = HertzGaussian()
    maps = np.stack([encoder.encode(one, GRID) for one in scenes(rng, 100)])
    frames = [blank(rng) for _ in range(50)]
    model = UNet(ModelContext("contacts", GRID, MAX_DEPTH_MM, encoder=encoder), width=options.width)
    with limited_threads(1):
        scored = model.predict(frames[:3])
        truth = [Contacts.truth([[0, 0]], [1.0])] * 3  # random weights have no error to compare
        comparison = compare_configurations(
            model, frames[:3], scored, truth, compiled=options.compile
        )
    entries = {PLAIN: with_true_maps(plain(model), maps)}
    entries |= {one.name: with_true_maps(one.stages, maps) for one in comparison.usable}
    amx = "amx_bf16" in facts["cpu_flags"]
    weights = model.parameter_count()
    print(
        f"U-Net of width {options.width}, {weights:,} weights; {facts['cpu']}, AMX: "
        f"{'yes' if amx else 'no'}, torch {facts['torch']}"
    )
    for name, reason in comparison.skipped.items():
        print(f"left out: {name}: {reason if name != COMPILED else 'add --compile'}")
    chosen = ""
    for threads in counts:
        clocks = {"wall clock": time.perf_counter}
        if threads == 1:
            clocks["processor time"] = time.thread_time
        for clock_name, clock in clocks.items():
            with limited_threads(threads):
                samples = time_in_rounds(
                    entries,
                    frames,
                    threads=threads,
                    calls=options.calls,
                    rounds=options.calls // 10,
                    clocks=Clocks(wall=clock),
                    budget_s=60,
                )
            chosen = chosen or fastest(comparison.usable, samples).name
            print(f"{threads} thread{'s' if threads > 1 else ''}, {clock_name}")
            ratios = {n: show(sample, n, samples[PLAIN]) for n, sample in samples.items()}
            print(
                f"  p90, plain / timed ({chosen}): {ratios[chosen]:.2f}, must reach {NEEDED[amx]}"
            )


if __name__ == "__main__":
    main()
