"""Print the errors of the shipped models beside their targets, from real runs.

    python benchmarks/accuracy.py                        every model, exp1, exp2 and exp3, 3 seeds
    python benchmarks/accuracy.py --models unet cnn --protocols exp1 --seeds 1
    python benchmarks/accuracy.py --param sensor.instance=3   the same table on another sensor
    python benchmarks/accuracy.py --data path/to/331     and `surface` on real frames

Trained weights and stored runs are used where they exist; only missing ones are computed. The runs
are made by the command line. Prints a row per figure: its mean over the seeds and the seeds' range;
then for exp2 by how much training on several contacts changes the error, with a paired interval
over presses; at the end every target and the models that meet it. Exit code 1 when a target is
missed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactibench.metrics import Trials, press_means
from tactibench.plugins import PluginHost
from tactibench.records import StoredRun, open_run, unpack_contacts
from tactibench.stats import mean_interval, sign_flip_p

Row = tuple[str, str]
"""Metric and group."""
Means = dict[Row, float | None]

REFERENCES = {"mean", "nearest"}
"""Models in every board that have no target."""
REGIMES = {"exp1": ("single",), "exp2": ("single", "multiple"), "exp3": ("single", "multiple")}
SHOWN: dict[str, tuple[Row, ...]] = {
    "exp1": (
        *(("mae_mm", axis) for axis in ("x", "y", "z", "mean")),
        ("missed", "all"),
        *(("rmse_over_bound", axis) for axis in ("x", "y", "z")),
    ),
    "exp2": (
        ("distance_mae_mm", "all"),
        ("resolved", "all"),
        ("distance_penalised_mm", "all"),
        ("depth_mae_mm", "all"),
    ),
    "exp3": (("position_mean_mm", "triple"), ("depth_mae_mm", "triple"), ("missed", "triple")),
}
SURFACE: tuple[Row, ...] = (("depth_mae_mm", "all"), ("tilt_mae_deg", "all"), ("coverage", "all"))


@dataclass(frozen=True)
class Target:
    """The values that a model must reach.

    Attributes:
        protocol: Name of the protocol.
        regime: Regime of the training.
        model: Name of the model; "" where it is enough that any one model reaches the values.
        limits: Metric and group -> least and largest value.
    """

    protocol: str
    regime: str
    model: str
    limits: dict[Row, tuple[float, float]]

    def met(self, means: Means) -> bool:
        return all(
            (value := means.get(row)) is not None and least <= value <= most
            for row, (least, most) in self.limits.items()
        )


def _single(model: str, most_mm: float) -> Target:
    limits = {("mae_mm", "mean"): (0.0, most_mm), ("missed", "all"): (0.0, 0.0)}
    return Target("exp1", "single", model, limits)


def _pairs(regime: str, most_mm: float) -> Target:
    limits = {
        ("distance_mae_mm", "all"): (0.0, most_mm),
        ("resolved", "all"): (0.98, 1.0),
        ("depth_mae_mm", "all"): (0.0, 0.1),
    }
    return Target("exp2", regime, "", limits)


TARGETS = (
    _single("unet", 0.030),
    _single("cnn", 0.050),
    _single("vgnn", 0.040),
    _single("superpose", 0.030),
    Target("exp1", "single", "", {("rmse_over_bound", a): (0.0, 4.0) for a in ("x", "y", "z")}),
    _pairs("single", 0.15),
    _pairs("multiple", 0.08),
    Target(
        "exp3",
        "single",
        "",
        {
            ("position_mean_mm", "triple"): (0.0, 0.15),
            ("depth_mae_mm", "triple"): (0.0, 0.12),
            ("missed", "triple"): (0.0, 0.02),
        },
    ),
)


def run(store: Path, *options: str) -> StoredRun:
    """Make a run by the command line, as a user would, and open what it stored."""
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


def show(title: str, runs: Sequence[StoredRun], rows: Sequence[Row]) -> Means:
    """Print figures of one configuration and return their means over the runs (seeds)."""
    means: Means = {}
    for metric, group in rows:
        values = [
            row.value
            for stored in runs
            for row in stored.record.metrics
            if (row.metric, row.group) == (metric, group)
        ]
        finite = [value for value in values if value is not None]
        mean = float(np.mean(finite)) if finite and len(finite) == len(runs) else None
        means[metric, group] = mean
        text = "n/a" if mean is None else f"{mean:9.4f} [{min(finite):.4f}, {max(finite):.4f}]"
        print(f"{title:28}{metric:24}{group:8}{text}", flush=True)
    return means


def judge(found: dict[tuple[str, str, str], Means]) -> Iterator[tuple[str, bool]]:
    """Yield a line, and whether the target is met, for every target of a model that was run."""
    for target in TARGETS:
        asked = {
            model: means
            for (protocol, regime, model), means in found.items()
            if (protocol, regime) == (target.protocol, target.regime)
            and model == (target.model or model)
        }
        if not asked:
            continue
        limits = ", ".join(
            f"{metric} {group} in [{least:g}, {most:g}]"
            for (metric, group), (least, most) in target.limits.items()
        )
        by = [model for model, means in asked.items() if target.met(means)]
        who = target.model or "any model"
        met = f"met by {', '.join(by)}" if by else "MISSED"
        yield f"{target.protocol} {target.regime} {who}: {limits}: {met}", bool(by)


def trials(stored: StoredRun) -> Trials:
    """Return the stored answers of a run."""
    truth = stored.arrays("truth")
    return Trials(
        truth=unpack_contacts(truth),
        predictions=unpack_contacts(stored.arrays("predictions")),
        press=truth["press"],
        group=tuple(str(name) for name in truth["group"]),
    )


def show_gain(model: str, multiple: StoredRun, single: StoredRun) -> None:
    """Print how training on several contacts changes the error of exp2."""
    rng = np.random.default_rng(np.random.SeedSequence(0))
    first, second = (
        press_means("distance_penalised_mm", trials(run))[:, 0] for run in (multiple, single)
    )
    differences = (first - second)[np.isfinite(first - second)]
    p = sign_flip_p(differences, rng=rng)
    change = mean_interval(differences, np.arange(len(differences)))
    print(
        f"exp2 {model} multiple - single   distance_penalised_mm   {change.value:9.4f} "
        f"[{change.low:.4f}, {change.high:.4f}] {change.clusters} presses  p {p:.4f}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs"), help="the run store")
    parser.add_argument("--models", nargs="+", help="default: all but the trivial ones")
    parser.add_argument("--protocols", nargs="+", default=list(REGIMES), choices=list(REGIMES))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--param", action="append", default=[], help="as of `tactibench run`")
    parser.add_argument("--data", help="folder of real plate presses for `surface`")
    asked = parser.parse_args()
    specs = {spec.name: spec for spec in PluginHost().models}
    options = [word for value in asked.param for word in ("--param", value)]
    means: dict[tuple[str, str, str], Means] = {}
    for protocol in asked.protocols:
        for model in asked.models or sorted(set(specs) - REFERENCES):
            done: dict[str, StoredRun] = {}
            for regime in REGIMES[protocol]:
                if regime == "multiple" and specs[model].max_contacts is not None:
                    continue
                words = (protocol, "--model", model, "--regime", regime, *options)
                runs = [run(asked.out, *words, "--seed", str(s)) for s in range(asked.seeds)]
                done[regime] = runs[0]
                title = f"{protocol} {model} {regime}"
                means[protocol, regime, model] = show(title, runs, SHOWN[protocol])
            if protocol == "exp2" and len(done) == 2:
                show_gain(model, done["multiple"], done["single"])
    if asked.data:
        show(
            "surface cnn",
            [run(asked.out, "surface", "--model", "cnn", "--data", asked.data)],
            SURFACE,
        )
    missed = 0
    for line, met in judge(means):
        print(line)
        missed |= not met
    return int(missed)


if __name__ == "__main__":
    raise SystemExit(main())
