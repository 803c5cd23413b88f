#!/usr/bin/env python3
"""Show the error on sensors that no training saw against the number of training sensors.

    for k in 0 4 16 64; do tactibench run exp1 --model superpose --param sensor.instances=$k; done
    python benchmarks/training_sensors.py runs --picture docs/images/training_sensors.png

Takes every run of `exp1` in a store and prints, for each model and number of training instances,
GOSPA in x and y on the eight instances that it is tested on, with the 95 % interval of the mean
over these (Student's t: the sensor is the unit, its seeds are averaged), and the worst of them. 0
and 1 instances are the nominal sensor alone.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path
from statistics import fmean

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from scipy import stats

from tactibench.records import RECORD, Record, open_run
from tactibench.report import Column, print_table, table

METRIC, SENSOR = "gospa1_mm", "unseen:instance-"


def main() -> None:
    """Print the table, and draw the picture if asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("store", type=Path)
    parser.add_argument("--picture", type=Path, metavar="PNG")
    given = parser.parse_args()
    seeds: dict[str, dict[int, dict[str, list[float]]]] = {}
    for path in sorted(given.store.glob(f"exp1-*/{RECORD}")):
        record = open_run(given.store, path.parent.name).record
        for row in record.metrics:
            if row.metric == METRIC and SENSOR in row.group and row.value is not None:
                counts = seeds.setdefault(_name(record), {})
                sensors = counts.setdefault(_sensors(record), defaultdict(list))
                sensors[row.group].append(row.value)
    curves = {
        name: {count: [fmean(of) for of in sensors.values()] for count, sensors in counts.items()}
        for name, counts in seeds.items()
    }
    rows = []
    for name, curve in sorted(curves.items()):
        for count, errors in sorted(curve.items()):
            middle, half = _mean(errors)
            cells = f"{middle:.3f} [{middle - half:.3f}, {middle + half:.3f}]", f"{max(errors):.3f}"
            rows.append([name, str(count), *cells])
    heads = (
        Column("model", right=False),
        Column("trained on"),
        Column("GOSPA in the plane, mm"),
        Column("worst"),
    )
    print_table(Console(), table(heads, rows, title="sensors that no training saw"))
    if given.picture:
        _draw(curves, given.picture)


def _name(record: Record) -> str:
    refined = record.model.parameters.get("refine", "none") != "none"
    return f"{record.model.name}, refined" if refined else record.model.name


def _sensors(record: Record) -> int:
    return max(1, int(str(record.sensor.parameters.get("instances", 0))))


def _mean(errors: list[float]) -> tuple[float, float]:
    """Return the mean, and half its 95 % interval."""
    half = stats.t.ppf(0.975, len(errors) - 1) * stats.sem(errors)
    return fmean(errors), float(half)


def _draw(curves: dict[str, dict[int, list[float]]], path: Path) -> None:
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    for place, (name, curve) in enumerate(sorted(curves.items())):
        counts = sorted(curve)
        means, halves = np.array([_mean(curve[count]) for count in counts]).T
        apart = np.array(counts) * 1.03 ** (place - len(curves) / 2)  # intervals beside each other
        axes.errorbar(apart, means, halves, marker="o", capsize=3, label=name)
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xticks([1, 4, 16, 64], ["1", "4", "16", "64"])
    ticks = [0.02, 0.05, 0.1, 0.2, 0.5]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("number of training sensors, 3,600 presses in all")
    axes.set_ylabel("GOSPA in the plane on eight other sensors, mm")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
