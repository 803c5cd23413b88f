#!/usr/bin/env python3
"""Test models on sensor instances that no training saw, after none and after some labelled presses.

    python benchmarks/unseen_instances.py kernel pins --param sensor.instances=16
    python benchmarks/unseen_instances.py superpose --shots 0 --protocols exp1 exp2 exp3
    python benchmarks/unseen_instances.py kernel --param sensor.instances=16 \\
        --protocols exp1 --shots 0 10 50 200 1000 --scratch 10 50 200 1000

There is one run for each protocol, model, instance and number of labelled presses, as `tactibench
run PROTOCOL --model MODEL --test sensor.instance=K --test shots=N`, but not timed; a run that is in
the store is not made again. With --scratch the model is also trained on so many presses of each
instance alone; the validation presses of that instance, which are not counted, decide when it
stops. Prints the mean over instances and, behind a slash, the worst. `in 95 %` is the share of
matched contacts inside the 95 % ellipse that the model states. `tactibench plot curve exp1
--new-sensor --store STORE` draws the same runs.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from rich.console import Console

from tactibench.metrics import Trials
from tactibench.metrics.registry import score
from tactibench.plugins import PluginHost
from tactibench.protocols import load_protocol
from tactibench.records import RECORD, StoredRun, cache_folder, open_run
from tactibench.report import Column, print_table, table
from tactibench.run import (
    NullReporter,
    RunRequest,
    TestOptions,
    execute,
    make_plan,
    read_parameters,
    trials_of,
)
from tactibench.sweep import read_choice

INSTANCES = tuple(range(1, 9))
"""Instances of the test: 0 is the nominal sensor, and trainings see instances from 10 on."""
ELLIPSE = "ellipse_95"


@dataclass(frozen=True)
class Figure:
    """A column of the table.

    Attributes:
        head: Head of the column.
        metric: Name of the metric.
        group: Group of the metric.
        digits: Number of printed decimals.
        scale: Factor on the value.
        least: Whether the smallest value is the worst.
    """

    head: str
    metric: str
    group: str
    digits: int
    scale: float = 1.0
    least: bool = False


IN_ELLIPSE = Figure("in 95 %", ELLIPSE, "all", 0, 100, least=True)
MISSED = Figure("missed, %", "missed", "all", 1, 100)
FIGURES = {
    "exp1": (Figure("MAE, mm", "mae_mm", "mean", 3), MISSED, IN_ELLIPSE),
    "exp2": (
        Figure("resolved, %", "resolved", "all", 1, 100, least=True),
        Figure("distance error, mm", "distance_mae_mm", "all", 3),
        Figure("penalised, mm", "distance_penalised_mm", "all", 2),
        IN_ELLIPSE,
    ),
    "exp3": (Figure("position, mm", "position_mean_mm", "all", 3), MISSED, IN_ELLIPSE),
}


def main() -> None:
    """Make the runs that are not in the store, and print a table for each protocol."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("models", nargs="+", help='such as kernel or "unet, width=32"')
    parser.add_argument("--protocols", nargs="+", choices=FIGURES, default=["exp1", "exp2"])
    parser.add_argument("--instances", nargs="+", type=int, default=INSTANCES)
    parser.add_argument("--shots", nargs="+", type=int, default=[0])
    parser.add_argument("--scratch", nargs="*", type=int, default=[])
    parser.add_argument("--param", action="append", default=[], help="of every run, as in run")
    parser.add_argument("--regime")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--store", type=Path, default=Path("runs"))
    options = parser.parse_args()
    console, host = Console(), PluginHost()
    for protocol in options.protocols:
        rows = []
        for label, requests in _requests(protocol, options):
            began = time.process_time()
            runs = [_run(request, host, options.store) for request in requests]
            rows.append([label, *_cells(runs, FIGURES[protocol])])
            console.print(f"{protocol} {label}: {time.process_time() - began:.0f} s of processor")
        heads = (Column("model", right=False), *(Column(f.head) for f in FIGURES[protocol]))
        count = len(options.instances)
        print_table(console, table(heads, rows, title=f"{protocol}: mean / worst of {count}"))


def _requests(protocol: str, options: Any) -> Iterator[tuple[str, list[RunRequest]]]:
    """Yield the label of a row and its runs, one for each instance."""
    given = read_parameters(tuple(options.param))
    for text in options.models:
        choice = read_choice(text)
        common = {**given, "model": {**given.get("model", {}), **choice.parameters}}
        fixed: dict[str, Any] = {"regime": options.regime, "seed": options.seed}
        for shots in options.shots:
            yield (
                f"{text}, {shots:,} labelled presses",
                [
                    RunRequest(
                        protocol, choice.name, parameters=common, test=_test(k, shots), **fixed
                    )
                    for k in options.instances
                ],
            )
        others = {kind: values for kind, values in common.items() if kind != "sensor"}
        for presses in options.scratch:
            yield (
                f"{text}, from scratch on {presses:,}",
                [
                    RunRequest(
                        protocol,
                        choice.name,
                        parameters={**others, "sensor": {"instance": str(k)}},
                        presses=presses,
                        **fixed,
                    )
                    for k in options.instances
                ],
            )


def _test(instance: int, shots: int) -> TestOptions:
    return TestOptions(parameters={"instance": str(instance)}, shots=shots)


def _run(request: RunRequest, host: PluginHost, store: Path) -> StoredRun:
    plan = make_plan(request, host, cache_folder(), store=store)
    if (store / plan.name / RECORD).is_file():
        return open_run(store, plan.name)
    return execute(plan, NullReporter(), timed=False)


def _cells(runs: Sequence[StoredRun], figures: Iterable[Figure]) -> Iterator[str]:
    """Yield mean and worst value over the instances, for each figure."""
    for figure in figures:
        values = [_value(run, figure) for run in runs]
        scaled = [figure.scale * value for value in values if value is not None]
        if len(scaled) < len(values):
            yield "n/a"
            continue
        worst = min(scaled) if figure.least else max(scaled)
        yield f"{fmean(scaled):.{figure.digits}f} / {worst:.{figure.digits}f}"


def _value(run: StoredRun, figure: Figure) -> float | None:
    if figure.metric != ELLIPSE:
        return run.record.value(figure.metric, figure.group)
    protocol = load_protocol(run.record.protocol.id).spec
    trials = trials_of(protocol, run.arrays("truth"), run.arrays("predictions"))
    assert isinstance(trials, Trials)  # noqa: S101 - all these protocols ask for contacts
    rows = score((ELLIPSE,), trials, rng=np.random.default_rng(0))
    return next((row.value for row in rows if row.group == figure.group), None)


if __name__ == "__main__":
    main()
