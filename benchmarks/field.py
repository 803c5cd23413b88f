"""Measure how fast the tiers of the simulator make displacement fields of dual scenes.

    PYTHONPATH=.:plugins python -P benchmarks/field.py [--threads 2] [--pins 127]

The scenes have two 3 mm tips, 7 mm apart, anywhere near the apex, 0.5 to 4 mm deep, and come in
batches, as sensors compute them. For every tier, medians of several rounds are printed, and in
brackets the fastest.

* /s: fields a second on one thread and on all; gain: the ratio of the two;
* cpu us: processor time of a field on all threads (fastest round). It hardly depends on other work
  of the machine: N free cores make N / cpu fields a second;
* of superpose: processor time as a multiple of the cheapest tier's.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import statistics
import time
from typing import NamedTuple

import numpy as np

from tactibench_sim.commands.tier_errors import TIERS
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.dome import Mechanics, mechanics_for
from tactibench_sim.mechanics.tables import shipped
from tactibench_sim.pins import layout
from tactibench_sim.rendered_sensor import BATCH, prefetch

BUDGET_S = 4.0
TARGET = 20_000


class Seconds(NamedTuple):
    """Seconds of one field: median and best by the clock, and of processors in the best round."""

    median: float
    best: float
    cpu: float


def batches(count: int) -> list[Tips]:
    rng = np.random.default_rng(0)
    yaw, depth = rng.uniform(0, np.pi, (count, 1)), rng.uniform(0.5, 4, (count, 1))
    away = 3.5 * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1) * np.array([[[-1.0], [1.0]]])
    xy = rng.uniform(-3, 3, (count, 1, 2)) + away
    depths = depth * np.concatenate([np.ones((count, 1)), rng.uniform(0.6, 1, (count, 1))], axis=1)
    return [
        Tips(xy[k : k + BATCH], depths[k : k + BATCH], np.full(len(xy[k : k + BATCH]), 3.0))
        for k in range(0, count, BATCH)
    ]


def timed(tier: Mechanics, work: list[Tips], directions: np.ndarray, threads: int) -> Seconds:
    def one(tips: Tips) -> int:
        return len(tier.displacement(tier.loads(tips), directions)[0])

    one(work[0])
    times: list[float] = []
    processor: list[float] = []
    begun = time.perf_counter()
    while len(times) < 3 or (len(times) < 15 and time.perf_counter() - begun < BUDGET_S):
        start, before = time.perf_counter(), time.process_time()
        done = sum(prefetch(one, work, threads))
        times.append((time.perf_counter() - start) / done)
        processor.append((time.process_time() - before) / done)
    return Seconds(statistics.median(times), min(times), min(processor))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=4096, help="fields a round")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--pins", type=int, choices=(127, 331), default=127)
    asked = parser.parse_args()
    directions, cheapest = layout(asked.pins), None
    print(f"dual scenes, {asked.pins} pins; target of coupled on 2 cores: {TARGET:,} /s")
    print(
        f"{'tier':11}{'1 thread /s':>12}{'best':>10}{asked.threads:>6} threads /s{'best':>10}"
        f"{'gain':>6}{'cpu us':>9}{'of superpose':>14}"
    )
    tables = shipped()
    for name in TIERS:
        tier = mechanics_for(name, tables)
        work = batches(asked.count)
        single, threaded = (timed(tier, work, directions, n) for n in (1, asked.threads))
        cheapest = cheapest or threaded.cpu
        print(
            f"{name:11}{1 / single.median:12,.0f}{f'[{1 / single.best:,.0f}]':>10}"
            f"{1 / threaded.median:17,.0f}{f'[{1 / threaded.best:,.0f}]':>10}"
            f"{single.best / threaded.best:6.2f}{1e6 * threaded.cpu:9.1f}"
            f"{threaded.cpu / cheapest:14.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
