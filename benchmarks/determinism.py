"""Test whether data, weights, predictions and metrics of a small run are always the same bits.

    python benchmarks/determinism.py [--models cnn ...] [--protocol exp1] [--sensor S] [--json FILE]

The run is made several times, each in a process of its own with its own cache and another seed of
Python's hashes: first one alone, then two at once, then one with another number of threads. It is a
``--quick`` run with the seed 0. Exit code 1 when anything differs in a bit.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tactibench.errors import UserError

THREADS = "OMP_NUM_THREADS"
ALONE, TWO = "alone", ("first of two at once", "second of two at once")
FIGURES = 12
"""Number of printed figures of a hash."""

Hashes = dict[str, str]
"""Name of a result, such as "weights" -> its sha256."""


def hashes_of_run(request: dict[str, Any]) -> Hashes:
    """Make a run in this process and return the hashes of its results.

    Args:
        request: Settings of the run.

    Raises:
        UserError: The run cannot be planned, or its protocol changes sensors while it tests.
    """
    from tactibench.plugins import PluginHost
    from tactibench.records import arrays_hash, cache_folder, combined, digest
    from tactibench.run import (
        Evaluation,
        NullReporter,
        RunRequest,
        TestFrames,
        limited_threads,
        make_plan,
        open_frames,
        score_arrays,
        train_model,
    )

    reporter = NullReporter()
    plan = make_plan(RunRequest(**request, quick=True, device="cpu"), PluginHost(), cache_folder())
    if plan.spec.families or plan.spec.transfer is not None:
        raise UserError(
            f"protocol {plan.spec.id!r} changes sensors while it tests; take one that presses one "
            "sensor, such as exp1."
        )
    hashes = {
        f"frames, {role}": combined([open_frames(frames, reporter).hash for frames in sets])
        for role, sets in (
            ("fit", plan.frames.fit),
            ("validation", plan.frames.validation),
            ("test", plan.frames.test),
        )
    }
    model, weights = train_model(plan, reporter)
    evaluation = Evaluation(plan, model, TestFrames.open(plan, reporter), reporter)
    with limited_threads(1):  # as a run does
        predictions = evaluation.predict()
    arrays, maps = predictions
    metrics = score_arrays(plan.spec, evaluation.truth(), arrays, maps)
    return {
        **hashes,
        "weights": weights.hash,
        "predictions": arrays_hash({**arrays, **maps}),
        "metrics": digest([str(row) for row in metrics]),
    }


def repeat(request: dict[str, Any]) -> dict[str, Hashes]:
    """Make a run four times in processes of their own: name of a result -> time -> sha256.

    Raises:
        UserError: A process failed; the message is that of the process.
    """
    threads = os.environ.get(THREADS) or str(os.cpu_count() or 1)
    other = "2" if threads == "1" else "1"
    times: dict[str, Hashes] = {}
    with tempfile.TemporaryDirectory(prefix="tactibench-") as name:
        folder = Path(name)
        for names in ((ALONE,), TWO):
            begun = {name: _begin(request, folder / name, threads) for name in names}
            times |= _finish(begun)
        name = f"on {other} thread{'s' if other != '1' else ''}"
        times |= _finish({name: _begin(request, folder / name, other)})
    return {
        result: {time: hashes[result] for time, hashes in times.items()} for result in times[ALONE]
    }


def _begin(request: dict[str, Any], cache: Path, threads: str) -> subprocess.Popen[str]:
    cache.mkdir()
    environment = {
        **os.environ,
        "TACTIBENCH_CACHE": str(cache),
        THREADS: threads,
        # Another order of sets in each process, so that results that depend on it differ.
        "PYTHONHASHSEED": str(sum(map(ord, cache.name))),
    }
    return subprocess.Popen(
        [sys.executable, str(Path(__file__).resolve()), "--work", json.dumps(request)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def _finish(begun: dict[str, subprocess.Popen[str]]) -> dict[str, Hashes]:
    """Wait for all processes and return time -> hashes.

    No process is left behind when one fails or the user interrupts.

    Raises:
        UserError: A process failed; the message is that of the process.
    """
    hashes: dict[str, Hashes] = {}
    try:
        for time, process in begun.items():
            out, err = process.communicate()
            if process.returncode:
                last = (err.strip().splitlines() or ["it said nothing"])[-1]
                raise UserError(
                    last
                    if process.returncode == 2
                    else f"the process {time!r} ended with code {process.returncode}: {last}"
                )
            hashes[time] = json.loads(out.splitlines()[-1])
    finally:
        for process in begun.values():
            if process.poll() is None:
                process.kill()
                process.communicate()
    return hashes


def print_table(model: str, found: dict[str, Hashes]) -> None:
    """Print a line for each result, and where bits differ a line for each time."""
    for result, hashes in found.items():
        first, *others = hashes.values()
        if set(others) <= {first}:
            print(f"{model:12} {result:20} the same {len(hashes)} times  {first[:FIGURES]}")
            continue
        print(f"{model:12} {result:20} NOT THE SAME")
        for time, digest in hashes.items():
            print(f"{'':33} {digest[:FIGURES]} {time}")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--models", nargs="+", default=["cnn"])
    parser.add_argument("--protocol", default="exp1")
    parser.add_argument("--sensor")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--work", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    try:
        if given.work:
            print(json.dumps(hashes_of_run(json.loads(given.work))))
            return 0
        results = {
            model: repeat({"protocol": given.protocol, "model": model, "sensor": given.sensor})
            for model in given.models
        }
    except UserError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    for model, hashes in results.items():
        print_table(model, hashes)
    if given.json:
        given.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    same = all(
        len(set(times.values())) == 1 for what in results.values() for times in what.values()
    )
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
