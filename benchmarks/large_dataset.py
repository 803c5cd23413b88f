"""Measure processor time and memory of opening a large data set, with its index and without.

    python benchmarks/large_dataset.py [--samples 1000000]

The data set is written with ten channels a sample. Every figure is of a process of its own.
"""

from __future__ import annotations

import argparse
import hashlib
import resource
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import (
    CHANNEL_FILE,
    INDEX,
    JOURNAL,
    Header,
    Sample,
    write_header,
    write_row,
)

OPEN = """
import resource, sys
from pathlib import Path
from tactibench.datasets import open_dataset
began = resource.getrusage(resource.RUSAGE_SELF)
dataset = open_dataset(Path(sys.argv[1]))
last = dataset.samples[-1]
assert last.id == len(dataset.samples) - 1
dataset.signal(last)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


def write_dataset(folder: Path, count: int) -> None:
    """Write a closed data set of ``count`` samples with ten channels each."""
    row = np.arange(10, dtype=np.float32).tobytes()
    sha256 = hashlib.sha256(row).hexdigest()
    total = hashlib.sha256()
    indenter = Indenter(2.0, ((0.0, 0.0, 0.0),), "single")
    with (folder / JOURNAL).open("wb") as journal, (folder / CHANNEL_FILE).open("wb") as channels:
        for number in range(count):
            scene = Scene(indenter, Pose(0.001 * (number % 5000), 1.0, 0.0, 0.0, 2.0))
            sample = Sample(number, CHANNEL_FILE, sha256, scene=scene, press=str(number))
            line = write_row(sample, 20.0)
            journal.write(line)
            total.update(line)
            channels.write(row)
    header = Header("large", {"name": "skin"}, signal=(10,), dome_radius_mm=20.0)
    counts = {"samples": count, "ok": count, "presses": count}
    closed = replace(header, status="closed", counts=counts, journal_sha256=total.hexdigest())
    write_header(folder, closed)


def opened(folder: Path) -> tuple[float, float]:
    """Return processor seconds and peak MB of opening a data set and reading its last sample."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    words = [sys.executable, "-c", OPEN, str(folder)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, float(done.stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=1_000_000)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_dataset(folder, asked.samples)
        size = (folder / JOURNAL).stat().st_size / 1e6
        print(f"{asked.samples:,} samples, journal of {size:,.0f} MB")
        for way in ("first, without an index", "by the index"):
            seconds, peak = opened(folder)
            print(f"{way:26}{seconds:7.1f} s of processor {peak:7,.0f} MB", flush=True)
        print(f"index of {(folder / INDEX).stat().st_size / 1e6:,.0f} MB")


if __name__ == "__main__":
    main()
