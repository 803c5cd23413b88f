"""Measure processor time and memory of opening a large data set, and of a database in its place.

    python benchmarks/large_dataset.py [--samples 1000000]

The data set is written with ten channels a sample. The database holds the lines of the journal by
id (SQLite, WAL). Every figure is of a process of its own: opening and reading the last sample, then
reading all samples.
"""

from __future__ import annotations

import argparse
import hashlib
import sqlite3
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import CHANNEL_FILE, JOURNAL, Header, Sample, write_header, write_row

FILES = """
dataset = open_dataset(folder)
samples = dataset.samples
last = samples[-1]
"""
DATABASE = """
base = sqlite3.connect(folder / "journal.db")
(line,) = base.execute("select line from samples order by id desc limit 1").fetchone()
last = read_row(line.encode(), "")
samples = (read_row(line.encode(), "") for (line,) in base.execute("select line from samples"))
"""
PROGRAM = """
import resource, sqlite3, sys, time
from pathlib import Path
from tactibench.datasets import open_dataset
from tactibench.datasets.schema import read_row
folder, begin = Path(sys.argv[1]), time.process_time()
{}
opened = time.process_time() - begin
count = sum(1 for _ in samples)
print(opened, time.process_time() - begin - opened, last.id == count - 1)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


def write_dataset(folder: Path, count: int) -> None:
    """Write a closed data set of ``count`` samples with ten channels each, and the database."""
    row = np.arange(10, dtype=np.float32).tobytes()
    sha256, total = hashlib.sha256(row).hexdigest(), hashlib.sha256()
    base = sqlite3.connect(folder / "journal.db")
    base.execute("pragma journal_mode=wal")
    base.execute("create table samples (id integer primary key, line text)")
    with (folder / JOURNAL).open("wb") as journal, (folder / CHANNEL_FILE).open("wb") as channels:
        for number in range(count):
            scene = Scene(Indenter.single(2.0), Pose(0.001 * (number % 5000), 1.0, depth=2.0))
            sample = Sample(number, CHANNEL_FILE, sha256, scene=scene, press=str(number))
            line = write_row(sample, 20.0)
            journal.write(line)
            total.update(line)
            channels.write(row)
            base.execute("insert into samples values (?, ?)", (number, line.decode()))
    base.commit()
    base.close()
    header = Header("large", {"name": "skin"}, signal=(10,), dome_radius_mm=20.0)
    counts = {"samples": count, "ok": count, "presses": count}
    closed = replace(header, status="closed", counts=counts, journal_sha256=total.hexdigest())
    write_header(folder, closed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=1_000_000)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_dataset(folder, asked.samples)
        for name, code in (("lines of JSON", FILES), ("SQLite", DATABASE)):
            words = [sys.executable, "-c", PROGRAM.format(code), str(folder)]
            done = subprocess.run(words, capture_output=True, text=True, check=True)
            opened, all_read, right, peak = done.stdout.split()
            if right != "True":
                raise SystemExit(f"{name}: the last sample is another one")
            print(
                f"{name:15} open {float(opened):6.2f} s, all samples {float(all_read):6.1f} s of "
                f"processor, {float(peak):7,.0f} MB",
                flush=True,
            )


if __name__ == "__main__":
    main()
