"""Measure how fast the simulated TacTip makes frames, stage by stage, on one core and on several.

    PYTHONPATH=.:plugins python -P benchmarks/generate.py [--threads 2]

(-P keeps files of this folder from hiding packages of the same name.)

Printed are medians of several rounds, and in brackets the fastest, for both pin patterns, single
and dual presses at 128 and 256 px:

* field: scenes to pin tips; render: pin tips to frames with noise (us a frame, one thread);
* render /s and whole /s: frames a second on one thread and on all, of rendering alone and from
  scenes with ``press_many``; gain: the ratio of the two;
* cpu us: processor time of a frame on all threads (fastest round). It hardly depends on other work
  of the machine: N free cores make N / cpu frames a second.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import statistics
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench_sim import BATCH, SimulatedTacTip, TacTip127, TacTip331, prefetch, streams

SEED = np.random.SeedSequence(0)


class Seconds(NamedTuple):
    """Seconds of one frame: median and best by the clock, and of processors in the best round."""

    median: float
    best: float
    cpu: float


def scenes(kind: str, count: int) -> list[Scene]:
    rng = np.random.default_rng(0)
    reach, deepest = (6.4, 6.0) if kind == "single" else (3.0, 4.0)
    indenter = Indenter.single() if kind == "single" else Indenter.dual(7.0)
    return [
        Scene(
            indenter,
            Pose(x, y, rng.uniform(-180, 180), 0, rng.uniform(0.5, deepest)),
        )
        for _ in range(count)
        for x, y in [rng.uniform(-reach, reach, 2)]
    ]


def timed(work: Callable[[], object], rounds: int, frames: int) -> Seconds:
    work()
    times, processor = [], []
    for _ in range(rounds):
        start, before = time.perf_counter(), time.process_time()
        work()
        times.append((time.perf_counter() - start) / frames)
        processor.append((time.process_time() - before) / frames)
    return Seconds(statistics.median(times), min(times), min(processor))


def consumed(frames: Iterable[object]) -> int:
    return sum(1 for _ in frames)


def stages(
    kind: type[SimulatedTacTip], size: int, several: list[Scene], threads: int
) -> dict[str, Callable[[], object]]:
    sensor, wide = (kind(SensorContext(SEED), size=size) for _ in range(2))
    sensor.threads, wide.threads = 1, threads
    batches = [several[k : k + BATCH] for k in range(0, len(several), BATCH)]
    points = [sensor.points(batch) for batch in batches]
    states = [streams(SEED, k * BATCH, len(batch)) for k, batch in enumerate(batches)]

    def render(k: int) -> np.ndarray:
        return sensor.renderer.frames(points[k], states[k])

    return {
        "field": lambda: [sensor.points(batch) for batch in batches],
        "render": lambda: consumed(prefetch(render, range(len(batches)), 1)),
        "render N": lambda: consumed(prefetch(render, range(len(batches)), threads)),
        "whole": lambda: consumed(sensor.press_many(several)),
        "whole N": lambda: consumed(wide.press_many(several)),
    }


def rates(one: Seconds, several: Seconds) -> str:
    return (
        f"{1 / one.median:9.0f} [{1 / one.best:6.0f}]{1 / several.median:9.0f} "
        f"[{1 / several.best:6.0f}] x{one.best / several.best:4.2f}{1e6 * several.cpu:7.0f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1024, help="presses a round")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--sizes", type=int, nargs="+", default=[128, 256])
    asked = parser.parse_args()
    head = f"{'1 thread':>9}{'best':>9}{asked.threads:>9} threads, gain  cpu us"
    print(
        f"{'sensor':11}{'scene':7}{'px':>4}{'field us':>9}{'render us':>10}  render /s:{head}"
        f"  whole /s:{head}"
    )
    for kind in (TacTip127, TacTip331):
        for name in ("single", "dual"):
            for size in asked.sizes:
                presses = scenes(name, asked.count)
                work = stages(kind, size, presses, asked.threads)
                each = {s: timed(w, asked.rounds, asked.count) for s, w in work.items()}
                print(
                    f"{kind.__name__:11}{name:7}{size:4}"
                    f"{1e6 * each['field'].median:9.0f}{1e6 * each['render'].median:10.0f}"
                    f"{'':12}{rates(each['render'], each['render N'])}"
                    f"{'':12}{rates(each['whole'], each['whole N'])}",
                    flush=True,
                )
    presses = scenes("single", 200)
    sensor = TacTip127(SensorContext(SEED))
    seconds = timed(lambda: [sensor.bound(s) for s in presses], 3, 200).median
    print(f"bound, tactip-127, single: {1e3 * seconds:.2f} ms a scene")


if __name__ == "__main__":
    main()
