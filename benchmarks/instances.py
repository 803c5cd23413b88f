#!/usr/bin/env python3
"""Measure the time to make a sensor instance, and to press many instances instead of one.

    PYTHONPATH=.:plugins python benchmarks/instances.py [--repeats 20]

An instance is made as in a training: fields between nine domes, their splines, lens and light of
every pixel, the rest frame. "again" is an instance whose fields are still in memory: a run opens a
sensor for every 250 presses. Compiled loops and tables are loaded before the clock starts. The last
lines are for 250 presses spread over instances, with the memory that the process took.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import numpy as np

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench.protocols import CHUNK
from tactibench_sim import (
    RESERVED,
    SimulatedTacTip,
    TacTip127,
    TacTip331,
    instance_mechanics,
    instance_tables,
)

SCENES = [
    Scene(Indenter.single(), Pose(k % 9 - 4, k % 7 - 3, depth=0.5 + k % 25 / 10))
    for k in range(CHUNK)
]


def main() -> None:
    """Print milliseconds for each instance, seconds for each chunk of presses, and memory."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=20)
    repeats = parser.parse_args().repeats
    for kind in (TacTip127, TacTip331):
        name = kind.__name__
        made(kind, instance=RESERVED)  # loads the tables and the compiled loops
        forget()
        numbers = range(RESERVED, RESERVED + repeats)
        once, again = ([clock(partial(made, kind, instance=n)) for n in numbers] for _ in range(2))
        print(
            f"{name} instance: {1e3 * median(once):.1f} ms "
            f"(again {1e3 * median(again):.1f} ms), median of {repeats}"
        )
        nominal = [clock(partial(made, kind)) for _ in range(repeats)]
        print(f"{name} nominal: {1e3 * median(nominal):.1f} ms, median of {repeats}")
    for count in (0, 16, 64, 144):
        forget()
        filling, full = (clock(partial(press, count)) for _ in range(2))
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(
            f"{CHUNK} presses on {count or 1} instances: {filling:.2f} s, the next {full:.2f} s; "
            f"process at most {memory:.0f} MB"
        )


def made(kind: type[SimulatedTacTip], **parameters: Any) -> SimulatedTacTip:
    """Return a new sensor that computes on one thread."""
    sensor = kind(SensorContext(np.random.SeedSequence(0)), **parameters)
    sensor.threads = 1
    return sensor


def press(count: int) -> None:
    """Make a chunk of frames that is spread over ``count`` instances; 0: the nominal sensor."""
    for _ in made(TacTip127, instances=count).press_many(SCENES):
        pass


def forget() -> None:
    """Remove the instances that are kept in memory."""
    instance_tables.cache_clear()
    instance_mechanics.cache_clear()


def clock(work: Callable[[], object]) -> float:
    """Return the seconds that a piece of work takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
