"""Kill every stage of the work, call the same command again, and compare its final record.

    python benchmarks/faults.py [--kills 50] [--changes MOST] [--full MOST] [--stage NAME]...
                                [--sweeps KILLS] [--seed 0] [--json FILE]

The stages are: generate, export and import a data set, begin a plugin, train, predict (a run whose
weights are there), replace a stored run, score, board, submit, list, report, speed. They run on
tiny protocols, a sensor of twelve pixels and a model with one weight, so that most of the time goes
into files, which is where things break.

* --kills: SIGKILLs at random moments of the stage's measured running time.
* --changes: also a SIGKILL before each operation that changes the file system (opening for writing,
  fsync, rename, remove, making a folder), at most so many, spread over all.
* --sweeps: SIGKILLs of a sweep of 8 cells in processes of its own, in turns of all of them and of
  the first one alone.
* --full: also a disk that is full from such operations on.

The outcomes are:

* right: the same record as undisturbed.
* named: one sentence and exit code 2.
* lost: something that was there or should be there is missing.
* twice: a finished cell was run again.
* hung: the same command did not end, or a worker outlived its sweep.
* silent: another record, or half of one, without a message.

Exit code 1 when anything is lost, twice, hung or silent.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))

from killed import OUTCOMES, STAGES, Result, Trial, lab_in
from killed_sweep import SweepTrial

MEMORY = Path("/dev/shm")  # noqa: S108 - a folder of our own is made in it
"""Folder in memory: on a disk that others use, most of the time would go into fsync."""
STALLED = 20
"""Attempts for each kill that is wanted, because a command may end before its kill."""


def note(result: Result, how: str, outcome: tuple[str, str]) -> None:
    """Count the outcome of a stage that was stopped.

    Args:
        result: Counts of the stage.
        how: Description of the stop, for the list of outcomes that are not right.
        outcome: One of OUTCOMES, and a description of what is wrong.
    """
    result.stops += 1
    result.outcomes[outcome[0]] += 1
    if outcome[0] != "right":
        result.wrong.append(f"{how}: {outcome[0]}: {outcome[1]}")


def random_kills(trial: Trial, kills: int, rng: np.random.Generator) -> Result:
    result = Result(trial.stage.name)
    for _ in range(kills * STALLED):
        if result.stops == kills:
            break
        moment = float(rng.uniform(0, 1.05 * trial.seconds))
        folder = trial.killed_at(moment)
        if folder is not None:
            note(result, f"killed after {moment:.3f} s", trial.again(folder))
    return result


def sweep_kills(place: Path, kills: int, rng: np.random.Generator) -> Result:
    trial, result = SweepTrial(place), Result("sweep")
    for _ in range(kills * STALLED):
        if result.stops == kills:
            break
        moment, alone = float(rng.uniform(0, trial.seconds)), bool(result.stops % 2)
        outcome = trial.killed_at(moment, alone=alone)
        if outcome is not None:
            how = "the first process" if alone else "all processes"
            note(result, f"{how} killed after {moment:.3f} s", outcome)
    return result


def spread(trial: Trial, most: int) -> list[int]:
    """Return the numbers of the operations to stop at: all, or ``most`` over the whole command."""
    if trial.changes <= most:
        return list(range(1, trial.changes + 1))
    return sorted({round(at) for at in np.linspace(1, trial.changes, most)})


def kills_at_changes(trial: Trial, most: int) -> Result:
    result = Result(f"{trial.stage.name}, changes")
    for operation in spread(trial, most):
        folder = trial.killed_before(operation)
        if folder is not None:
            note(result, f"killed before change {operation}", trial.again(folder))
    return result


def full_disks(trial: Trial, most: int) -> Result:
    """Stop a stage by a full disk; the command must say so, and is called again with space."""
    result = Result(f"{trial.stage.name}, disk full")
    for operation in spread(trial, most):
        folder, code, output = trial.full_from(operation)
        reported = code == 2 and "the disk is full" in output and "Traceback" not in output
        if code == 0 and trial.stage.outcome(folder) == trial.outcome:
            continue  # the command had nothing left to write
        how = f"disk full from change {operation}"
        outcome = (
            trial.again(folder) if reported else ("silent", f"exit code {code}: {output[-600:]}")
        )
        note(result, how, outcome)
    return result


HEAD = f"{'stage':24}{'stops':>8}" + "".join(f"{name:>8}" for name in OUTCOMES)


def line(result: Result) -> str:
    counts = "".join(f"{result.outcomes[name]:8}" for name in OUTCOMES)
    return "\n".join(
        [f"{result.stage:24}{result.stops:8}{counts}", *(f"  {wrong}" for wrong in result.wrong)]
    )


def results_of(
    trial: Trial, kills: int, changes: int, full: int, rng: np.random.Generator
) -> Iterator[Result]:
    if kills:
        yield random_kills(trial, kills, rng)
    if changes:
        yield kills_at_changes(trial, changes)
    if full:
        yield full_disks(trial, full)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--changes", type=int, default=0, metavar="MOST")
    parser.add_argument("--full", type=int, default=0, metavar="MOST")
    parser.add_argument("--sweeps", type=int, default=0, metavar="KILLS")
    parser.add_argument("--stage", action="append", choices=[stage.name for stage in STAGES])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, dest="file")
    asked = parser.parse_args()
    began = time.perf_counter()
    results: list[Result] = []
    memory = MEMORY if os.access(MEMORY, os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=memory) as place:
        lab = lab_in(Path(place))
        print(HEAD)
        for number, stage in enumerate(STAGES):
            if asked.stage and stage.name not in asked.stage:
                continue
            trial = Trial(stage, lab, Path(place))
            rng = np.random.default_rng([asked.seed, number])
            for result in results_of(trial, asked.kills, asked.changes, asked.full, rng):
                print(line(result), flush=True)
                results.append(result)
        if asked.sweeps:
            result = sweep_kills(Path(place), asked.sweeps, np.random.default_rng(asked.seed))
            print(line(result), flush=True)
            results.append(result)
    stops = sum(result.stops for result in results)
    print(f"{stops} stops in {time.perf_counter() - began:.0f} s")
    if asked.file:
        asked.file.write_text(
            json.dumps(
                [
                    {
                        "stage": r.stage,
                        "stops": r.stops,
                        **{name: r.outcomes[name] for name in OUTCOMES},
                    }
                    for r in results
                ]
            )
        )
    bad = set(OUTCOMES) - {"right", "named"}
    return 1 if any(r.outcomes[name] for r in results for name in bad) else 0


if __name__ == "__main__":
    sys.exit(main())
