"""``tactibench run``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.completion import MODEL, PROTOCOL
from tactibench.cli.options import (
    board_option,
    full_option,
    json_option,
    request_options,
    save_json,
    store_option,
)

if TYPE_CHECKING:
    from tactibench.cli.output import Terminal
    from tactibench.run import RunPlan, TrainedWeights


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
    "test",
    multiple=True,
    metavar="reference|sensor.NAME=VALUE|shots=N|data=FOLDER",
    help="Test on other frames than the model is trained for: the sensor's reference scenes, a "
    "sensor with other parameters, after N labelled single presses of it, or (protocol transfer) "
    "the recording of another sensor.",
)
@click.option(
    "--hidden-seed",
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
@board_option
@full_option
@click.option("--train-only", is_flag=True, help="Train and keep the weights; test nothing.")
@click.option(
    "--fresh", is_flag=True, help="Make everything anew: frames, weights, answers and times."
)
@click.option("--dry-run", is_flag=True, help="Print the plan and stop.")
def run(
    protocol: str,
    model: str,
    json_file: Path | None,
    store: Path,
    board_folder: Path,
    full: bool,
    train_only: bool,
    fresh: bool,
    dry_run: bool,
    **options: Any,
) -> None:
    """Run PROTOCOL (such as exp1, exp2, fine, surface or a .toml file) with a model; score it.

    Prints about ten lines: errors, misses, speed, and the place on the board; --full prints all.
    Frames and weights are cached and shared; an interrupted run continues by the same command.
    """
    from tactibench import api
    from tactibench.cli.output import Terminal, show_run

    terminal = Terminal()
    plan = api.plan(protocol, model, store=store, **options)
    if train_only and not dry_run:
        _, trained = plan.train(terminal, fresh=fresh)
        _show_training(plan, trained, terminal, json_file)
        return
    if fresh or not plan.stored:  # a stored run was checked when it was made
        plan.check()
    if dry_run or not terminal.quiet:
        for line in plan.lines(fresh=fresh):
            terminal.say(line)
    if dry_run:
        return
    finished = plan.carry_out(terminal, fresh=fresh)
    show_run(terminal, finished, store, board_folder, full=full)
    save_json(json_file, finished.record.json_values())


def _show_training(
    plan: RunPlan, trained: TrainedWeights, terminal: Terminal, json_file: Path | None
) -> None:
    """Say how a model was trained, and where its weights are."""
    from tactibench.report import duration

    how = "found in the cache, trained" if trained.reused else "trained"
    report = trained.report
    facts = {
        "model": plan.components.model.label,
        "regime": plan.components.regime,
        "seed": plan.request.seed,
        "weights": trained.hash,
        "reused": trained.reused,
        "training_s": report["seconds"],
        "epochs": report["epochs"],
    }
    terminal.say(
        f"{facts['model']} ({facts['regime']}), seed {facts['seed']}: {how} {report['epochs']} "
        f"epochs on {plan.frames.count('fit'):,} presses in {duration(report['seconds'])}"
    )
    terminal.say(f"weights {trained.hash[:8]} in {trained.folder}")
    save_json(json_file, facts)
