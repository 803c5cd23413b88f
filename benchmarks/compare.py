"""Measure how long ``tactibench compare`` takes for two runs of 1,000 presses.

    python benchmarks/compare.py [--presses 1000] [--rounds 5]

Makes two runs of exp1 with random answers in a temporary store. Times the whole command in fresh
processes, with ``python -c pass`` beside it, and the comparison alone in this process.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tactibench.board import compare_runs
from tactibench.contacts import Contacts
from tactibench.protocols import load_protocol
from tactibench.records import (
    PARTS,
    SCHEMA,
    Record,
    arrays_hash,
    open_run,
    pack_contacts,
    write_run,
)
from tactibench.run import score_arrays

TARGET_S = 2.0


def stored(store: Path, name: str, presses: int, noise: float, rng: np.random.Generator) -> None:
    """Store a run of exp1 whose answers are off by normal noise.

    Args:
        store: Folder of the store.
        name: Name of the run.
        presses: Number of presses.
        noise: Standard deviation of the noise along each axis, mm.
        rng: Source of the noise.
    """
    protocol = load_protocol("exp1")
    xyz = np.random.default_rng(0).uniform([-6, -6, 1], [6, 6, 5], (presses, 3))
    answers = xyz + rng.normal(0, noise, xyz.shape)
    truth = pack_contacts([Contacts.truth([p[:2]], [p[2]]) for p in xyz])
    truth |= {"press": np.arange(presses).astype(str), "group": np.full(presses, "all")}
    predicted = pack_contacts([Contacts.truth([p[:2]], [p[2]]) for p in answers])
    parts = {name: {"none": np.empty(0)} for name in PARTS}
    parts |= {"truth": truth, "predictions": predicted}
    record = {
        "schema": SCHEMA,
        "name": name,
        "created": "2026-01-01T00:00:00+00:00",
        "protocol": {
            "id": "exp1",
            "version": protocol.spec.version,
            "hash": protocol.hash,
            "title": protocol.spec.title,
        },
        "model": {"name": name, "parameters": {}},
        "regime": "single",
        "encoder": None,
        "sensor": {"name": "none", "origin": "simulated", "parameters": {}},
        "seed": 0,
        "partial": False,
        "limits": {},
        "environment": {},
        "speed": [],
        "timed": {},
        "identity": {
            "weights_hash": "",
            "predictions_hash": arrays_hash(predicted),
            "stored": {},
            "data": ["the same"],
        },
        "metrics": score_arrays(protocol.spec, truth, predicted, {}),
        "training": {},
        "data": {"test": presses},
        "signature": "",
    }
    write_run(store, Record.model_validate(record), parts)


def seconds(arguments: list[str]) -> tuple[float, float]:
    """Return wall and processor seconds of a fresh process; other work slows only the wall."""
    start, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    spent, after = time.perf_counter() - start, os.times()
    used = after.children_user + after.children_system
    return spent, used - before.children_user - before.children_system


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--presses", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        store, rng = Path(folder), np.random.default_rng(1)
        for name, noise in (("first", 0.05), ("second", 0.06)):
            stored(store, name, options.presses, noise, rng)
        command = ["-m", "tactibench", "compare", "first", "second", "--out", str(store)]
        seconds(command)  # writes the byte code
        command_times, pass_times = [], []
        for _ in range(options.rounds):  # in turn, so that a busy moment falls on both
            command_times.append(seconds(command))
            pass_times.append(seconds(["-c", "pass"]))
        runs = [open_run(store, name) for name in ("first", "second")]
        start = time.perf_counter()
        compare_runs(runs)
        inside = time.perf_counter() - start
    middle = statistics.median(wall for wall, _ in command_times)
    least = min(wall for wall, _ in command_times)
    work = statistics.median(used for _, used in command_times)
    print(f"{options.presses:,} presses, {options.rounds} rounds")
    print(
        f"tactibench compare   median {middle:.2f} s, least {least:.2f} s, processor {work:.2f} s"
    )
    print(f"python -c pass       median {statistics.median(wall for wall, _ in pass_times):.2f} s")
    print(f"the comparison alone {inside:.2f} s")
    print(f"target: median at most {TARGET_S:g} s: {'met' if middle <= TARGET_S else 'missed'}")
    return int(middle > TARGET_S)


if __name__ == "__main__":
    sys.exit(main())
