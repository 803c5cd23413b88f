"""Measure how long ``tactibench run exp2 --model unet`` takes, as a researcher types it.

    python benchmarks/main_job.py                  all jobs, about 10 minutes on 2 cores
    python benchmarks/main_job.py --only quick     one job; again and fresh need cold

Every job runs as a process of its own in a cache and a store made for this call:

    cold   empty cache: frames are generated, the U-Net trained, predictions timed and scored
    again  the same command: the stored record is shown
    fresh  the same command with --fresh: frames and weights from the cache, all else made again
    quick  --quick in a cache of its own

Prints wall seconds beside the targets, and the machine. Exit code 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.run import fingerprint, fingerprint_hash


@dataclass(frozen=True)
class Job:
    """A command that is timed.

    Attributes:
        name: Name of the job.
        options: Options of the command.
        target_s: Largest wall time, s.
        warm: Whether the job needs the cache and store that ``cold`` filled.
    """

    name: str
    options: tuple[str, ...]
    target_s: float
    warm: bool


JOBS = (
    Job("cold", (), 480.0, warm=False),
    Job("again", (), 10.0, warm=True),
    Job("fresh", ("--fresh",), 10.0, warm=True),
    Job("quick", ("--quick",), 60.0, warm=False),
)


def chosen(names: list[str]) -> list[Job]:
    """Return the jobs of these names, or all, with ``cold`` before jobs that need it."""
    wanted = {*names} or {job.name for job in JOBS}
    if any(job.name in wanted and job.warm for job in JOBS):
        wanted.add("cold")
    return [job for job in JOBS if job.name in wanted]


def seconds(job: Job, folder: Path, protocol: str, model: str) -> float:
    """Return the wall time of a job, s; its output goes to a log file, shown when the job fails.

    Args:
        job: Job to run.
        folder: Folder of caches, stores and logs.
        protocol: Name of the protocol.
        model: Name of the model.
    """
    place = folder / ("quick" if job.name == "quick" else "main")
    place.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "tactibench", "run", protocol, "--model", model, *job.options]
    environment = {**os.environ, "TACTIBENCH_CACHE": str(place / "cache")}
    log = place / f"{job.name}.log"
    start = time.perf_counter()
    with log.open("wb") as stream:
        done = subprocess.run(
            [*command, "--out", str(place / "runs")],
            check=False,
            stdout=stream,
            stderr=subprocess.STDOUT,
            env=environment,
        )
    wall_s = time.perf_counter() - start
    if done.returncode:
        sys.exit(f"{' '.join(command)} failed:\n{log.read_text(encoding='utf-8')[-2000:]}")
    return wall_s


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = [job.name for job in JOBS]
    parser.add_argument("--only", action="append", choices=names, default=[], help="repeatable")
    parser.add_argument("--protocol", default="exp2")
    parser.add_argument("--model", default="unet")
    parser.add_argument("--json", type=Path, help="write the rows here")
    asked = parser.parse_args()
    machine = fingerprint()
    busy = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name:
        print(f"tactibench run {asked.protocol} --model {asked.model}; load before: {busy:.1f}")
        print(f"{'job':8}{'options':12}{'seconds':>9}{'target':>9}")
        for job in chosen(asked.only):
            wall_s = seconds(job, Path(name), asked.protocol, asked.model)
            verdict = "" if wall_s <= job.target_s else "  missed"
            text = " ".join(job.options)
            print(f"{job.name:8}{text:12}{wall_s:9.1f}{job.target_s:9.0f}{verdict}", flush=True)
            rows.append(
                {
                    "metric": "wall_s",
                    "group": job.name,
                    "value": wall_s,
                    "unit": "s",
                    "target": job.target_s,
                }
            )
    print(
        f"machine {fingerprint_hash(machine)}: {machine['cpu']}, {machine['cores_logical']} cores, "
        f"{machine['memory_gib']} GiB, gpu {machine['gpu'] or 'none'}, torch {machine['torch']}"
    )
    if asked.json:
        asked.json.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")
    return int(any(row["value"] > row["target"] for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
