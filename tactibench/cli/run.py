"""``tactibench run``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.completion import MODEL, PROTOCOL
from tactibench.cli.options import (
    json_option,
    request_of,
    request_options,
    save_json,
    store_option,
)

if TYPE_CHECKING:
    from tactibench.cli.output import Terminal
    from tactibench.run.plan import RunPlan


@click.command()
@click.argument("protocol", type=PROTOCOL)
@click.option(
    "--model", type=MODEL, required=True, help="Model to score; mean and nearest are baselines."
)
@request_options(encoder="Heatmap encoder, for models that use one.", seed="Of training.")
@click.option(
    "--quick", is_flag=True, help="200 presses, 2 epochs, 40 tests: only proves the path."
)
@click.option("--limit", type=click.IntRange(min=1), help="Score at most this many test presses.")
@click.option(
    "--presses",
    type=click.IntRange(min=1),
    help="Learn from so many presses only; such a run is for the learning curve.",
)
@click.option(
    "--test",
    "tests",
    multiple=True,
    metavar="reference|sensor.NAME=VALUE|shots=N|data=FOLDER",
    help="Test on other frames than the model is trained for: the sensor's reference scenes, a "
    "sensor with other parameters, after N labelled single presses of it, or (protocol transfer) "
    "the recording of another sensor.",
)
@click.option(
    "--hidden-seed",
    "hidden",
    is_flag=True,
    help="Test on presses drawn from the secret seed in TACTIBENCH_HIDDEN_SEED.",
)
@click.option(
    "--published",
    "published",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="Released answers to the test frames; default: looked for beside --data.",
)
@json_option
@store_option
@click.option("--train-only", is_flag=True, help="Train and keep the weights; test nothing.")
@click.option("--fresh", is_flag=True, help="Predict, time and score again, even if stored.")
@click.option("--dry-run", is_flag=True, help="Print the plan and stop.")
def run(
    protocol: str,
    model: str,
    quick: bool,
    limit: int | None,
    presses: int | None,
    tests: tuple[str, ...],
    hidden: bool,
    json_file: Path | None,
    store: Path,
    train_only: bool,
    fresh: bool,
    dry_run: bool,
    **options: Any,
) -> None:
    """Run PROTOCOL (such as exp1, exp2, fine, surface or a .toml file) with a model; score it.

    Frames and weights are cached and shared; an interrupted run continues by the same command.
    """
    from tactibench.cli.output import Terminal, show_run
    from tactibench.plugins.host import PluginHost
    from tactibench.records.cache import cache_folder
    from tactibench.records.store import RECORD, open_run
    from tactibench.run.plan import make_plan, plan_lines
    from tactibench.run.request import read_test_options

    test = read_test_options(tests, hidden=hidden)
    request = request_of(
        protocol, model, options, quick=quick, limit=limit, presses=presses, test=test
    )
    terminal = Terminal()
    plan = make_plan(request, PluginHost(), cache_folder())
    if train_only and not dry_run:
        _train(plan, terminal, json_file)
        return
    stored = not fresh and (store / plan.name / RECORD).is_file()
    if not stored:  # a stored run was checked when it was made
        from tactibench.metrics.registry import check_metrics

        check_metrics(plan.protocol)
    for line in plan_lines(plan, stored):
        terminal.say(line)
    if dry_run:
        return
    if stored:
        finished = open_run(store, plan.name)
    else:
        from tactibench.run.execute import execute

        finished = execute(plan, store, terminal, fresh=fresh)
    show_run(terminal, finished, store)
    save_json(json_file, finished.record.json_values())


def _train(plan: RunPlan, terminal: Terminal, json_file: Path | None) -> None:
    """Train, or find the weights in the cache, and say where they are."""
    from tactibench.report.numbers import duration
    from tactibench.run.train import train_model

    _, trained = train_model(plan, terminal)
    report, model = trained.report, plan.components.model.label
    how = "found in the cache, trained" if trained.reused else "trained"
    terminal.say(
        f"{model} ({plan.components.regime}), seed {plan.request.seed}: {how} "
        f"{report['epochs']} epochs on {plan.frames.count('fit'):,} presses in "
        f"{duration(report['seconds'])}"
    )
    terminal.say(f"weights {trained.hash[:8]} in {plan.weights.folder}")
    facts = {
        "model": model,
        "regime": plan.components.regime,
        "seed": plan.request.seed,
        "weights": trained.hash,
        "reused": trained.reused,
        "training_s": report["seconds"],
        "epochs": report["epochs"],
    }
    save_json(json_file, facts)
