"""Whether data, weights, predictions and metrics of a small run are the same bits every time.

    python benchmarks/determinism.py [--models cnn ...] [--protocol exp1] [--sensor S] [--json FILE]

Each time is a process of its own with a cache of its own and another seed of Python's own hashes:
first one alone, then two at once, and once more the frames alone on another number of threads.
The run is a ``--quick`` one with the seed 0. Exit code 1 when anything differs in a bit.
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
"""Of a hash that is printed."""

Hashes = dict[str, str]
"""What was made -> sha256 of it."""


def hashes_of_run(request: dict[str, Any], *, frames_only: bool = False) -> Hashes:
    """Do the work in this process and return the hashes of what came out. Raises UserError."""
    from tactibench.plugins.host import PluginHost
    from tactibench.records.cache import cache_folder
    from tactibench.records.files import arrays_hash
    from tactibench.records.identity import combined, digest
    from tactibench.run.evaluation import Evaluation, TestFrames
    from tactibench.run.plan import make_plan
    from tactibench.run.reporter import NullReporter
    from tactibench.run.request import RunRequest
    from tactibench.run.score import score_arrays
    from tactibench.run.train import open_frames, train_model

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
    if frames_only:
        return hashes
    model, weights = train_model(plan, reporter)
    evaluation = Evaluation(plan, model, TestFrames.open(plan, reporter), reporter)
    predictions = evaluation.predict()
    maps = predictions.map_arrays
    metrics = score_arrays(plan.spec, evaluation.truth(), predictions.arrays, maps)
    return {
        **hashes,
        "weights": weights.hash,
        "predictions": arrays_hash({**predictions.arrays, **maps}),
        "metrics": digest([str(row) for row in metrics]),
    }


def repeat(request: dict[str, Any]) -> dict[str, Hashes]:
    """Work four times in processes of their own: what was made -> time -> sha256.

    Raises:
        UserError: in the words of the process, where one of them fails.
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
        times |= _finish({name: _begin(request, folder / name, other, frames_only=True)})
    return {
        what: {time: hashes[what] for time, hashes in times.items() if what in hashes}
        for what in times[ALONE]
    }


def _begin(
    request: dict[str, Any], cache: Path, threads: str, *, frames_only: bool = False
) -> subprocess.Popen[str]:
    cache.mkdir()
    environment = {
        **os.environ,
        "TACTIBENCH_CACHE": str(cache),
        THREADS: threads,
        # Another order of sets in each process: what depends on it shall show.
        "PYTHONHASHSEED": str(sum(map(ord, cache.name))),
    }
    work = json.dumps({"request": request, "frames_only": frames_only})
    return subprocess.Popen(
        [sys.executable, str(Path(__file__).resolve()), "--work", work],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def _finish(begun: dict[str, subprocess.Popen[str]]) -> dict[str, Hashes]:
    """Wait for all; none is left behind when one fails or the user interrupts."""
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
    """Print a line a thing, and where bits differ one a time."""
    for what, hashes in found.items():
        first, *others = hashes.values()
        if set(others) <= {first}:
            print(f"{model:12} {what:20} the same {len(hashes)} times  {first[:FIGURES]}")
            continue
        print(f"{model:12} {what:20} NOT THE SAME")
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
            print(json.dumps(hashes_of_run(**json.loads(given.work))))
            return 0
        found = {
            model: repeat({"protocol": given.protocol, "model": model, "sensor": given.sensor})
            for model in given.models
        }
    except UserError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    for model, hashes in found.items():
        print_table(model, hashes)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    same = all(len(set(times.values())) == 1 for what in found.values() for times in what.values())
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
