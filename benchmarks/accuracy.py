"""Errors of the shipped models beside their targets, from real runs of the command line.

    python benchmarks/accuracy.py                       exp1, exp2, exp3 on the simulated sensor
    python benchmarks/accuracy.py --data path/to/331    and `surface` on real frames

Takes about 25 minutes on 2 cores with an empty cache; trained weights are taken from it. Prints a
row per figure with its 95 % interval, and whether exp2 trained on several contacts is better than
trained on single ones by a paired interval over presses. Exit code 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.metrics.compare import compare
from tactibench.metrics.trials import Trials
from tactibench.records.answers import unpack_contacts
from tactibench.records.store import StoredRun, open_run


@dataclass(frozen=True)
class Figure:
    """One metric of one run. limit: what it must not exceed (or fall below), None: only shown."""

    metric: str
    group: str
    limit: float | None = None


RUNS: dict[tuple[str, str, str], tuple[Figure, ...]] = {
    ("exp1", "unet", "single"): (Figure("mae_mm", "mean", 0.06), Figure("missed", "all")),
    ("exp1", "cnn", "single"): (Figure("mae_mm", "mean", 0.08), Figure("missed", "all")),
    ("exp2", "unet", "single"): (
        Figure("distance_mae_mm", "all"),
        Figure("distance_penalised_mm", "all"),
        Figure("resolved", "all"),
    ),
    ("exp2", "unet", "multiple"): (
        Figure("distance_mae_mm", "all"),
        Figure("distance_penalised_mm", "all"),
        Figure("resolved", "all"),
    ),
    ("exp3", "unet", "single"): (
        Figure("position_mean_mm", "triple"),
        Figure("missed", "triple"),
    ),
    ("exp3", "unet", "multiple"): (
        Figure("position_mean_mm", "triple"),
        Figure("missed", "triple"),
    ),
}
SURFACE = (Figure("depth_mae_mm", "all"), Figure("tilt_mae_deg", "all"), Figure("coverage", "all"))


def run(store: Path, *options: str) -> StoredRun:
    """Carry a run out as a user would and open what it stored."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "record.json"
        command = [sys.executable, "-m", "tactibench", "run", *options]
        subprocess.run(
            [*command, "--out", str(store), "--json", str(record)],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        name = json.loads(record.read_text(encoding="utf-8"))["name"]
    return open_run(store, name)


def show(run_: StoredRun, title: str, figures: tuple[Figure, ...]) -> bool:
    """Print the figures of a run; True when a limit is missed."""
    missed = False
    for figure in figures:
        row: dict[str, Any] = next(
            row
            for row in run_.record["metrics"]
            if (row["metric"], row["group"]) == (figure.metric, figure.group)
        )
        value = row["value"]
        over = figure.limit is not None and (value is None or value > figure.limit)
        interval = f"[{row['low']:.4f}, {row['high']:.4f}]" if row["low"] is not None else ""
        target = f"target {figure.limit}" if figure.limit is not None else ""
        text = "n/a" if value is None else f"{value:.4f}"
        print(
            f"{title:24}{figure.metric:24}{figure.group:8}{text:>9} {interval:20} "
            f"{row['clusters']:5} presses  {target}{'  MISSED' if over else ''}",
            flush=True,
        )
        missed |= over
    return missed


def trials(run_: StoredRun) -> Trials:
    """The stored answers of a run."""
    truth = run_.arrays("truth")
    return Trials(
        truth=unpack_contacts(truth),
        predictions=unpack_contacts(run_.arrays("predictions")),
        press=truth["press"],
        group=tuple(str(name) for name in truth["group"]),
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs"), help="the run store")
    parser.add_argument("--data", help="folder of real plate presses for `surface`")
    asked = parser.parse_args()
    done, missed = {}, False
    for (protocol, model, regime), figures in RUNS.items():
        stored = run(asked.out, protocol, "--model", model, "--regime", regime)
        done[protocol, model, regime] = stored
        missed |= show(stored, f"{protocol} {model} {regime}", figures)
    single, multiple = (done["exp2", "unet", regime] for regime in ("single", "multiple"))
    paired = compare(
        "distance_penalised_mm",
        trials(multiple),
        trials(single),
        rng=np.random.default_rng(np.random.SeedSequence(0)),
    )
    change = paired.difference
    better = change.high is not None and change.high < 0
    print(
        f"exp2 multiple - single   distance_penalised_mm   all {change.value:9.4f} "
        f"[{change.low:.4f}, {change.high:.4f}] {change.clusters:5} presses  p {paired.p:.4f}"
        f"  {'multiple is better' if better else 'NOT BETTER'}"
    )
    if asked.data:
        stored = run(asked.out, "surface", "--model", "cnn", "--data", asked.data)
        show(stored, "surface cnn", SURFACE)
    return int(missed or not better)


if __name__ == "__main__":
    raise SystemExit(main())
