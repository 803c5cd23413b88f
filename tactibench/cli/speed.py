"""``tactibench speed``: models timed in turns, from trained weights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from tactibench.cli.options import json_option, request_of, request_options, save_json
from tactibench.errors import UserError


@click.command()
@click.argument("models", metavar="MODEL [MODEL]...", nargs=-1, required=True)
@click.option("--protocol", default="exp1", show_default=True, help="Whose weights and frames.")
@request_options(regime="Frames the weights were trained on; default: the protocol's first.")
@click.option("--train", is_flag=True, help="Train the weights where they are not in the cache.")
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    default=100,
    show_default=True,
    help="Test frames that are answered.",
)
@click.option(
    "--calls",
    type=click.IntRange(min=10),
    default=300,
    show_default=True,
    help="Timed calls at batch 1.",
)
@json_option
def speed(
    models: tuple[str, ...],
    protocol: str,
    train: bool,
    frames: int,
    calls: int,
    json_file: Path | None,
    **options: Any,
) -> None:
    """Time how long each MODEL takes from a frame to its answer.

    One frame a call is timed with one thread and with all, batches of frames with all. Several
    models are timed in turns in one job, so that their times can be compared.
    """
    from tactibench.cli.output import Terminal
    from tactibench.plugins import PluginHost
    from tactibench.records import SpeedRow, cache_folder
    from tactibench.report import print_table, speed_table
    from tactibench.run import (
        BATCHES,
        blinded,
        environment_facts,
        make_plan,
        no_weights,
        open_frames,
        time_models,
        train_model,
    )

    terminal, host = Terminal(), PluginHost()
    requests = [request_of(protocol, name, options, limit=frames) for name in models]
    plans = [make_plan(request, host, cache_folder()) for request in requests]
    for plan in plans:
        if not (train or plan.weights.cached):
            raise no_weights(plan, ", or add --train")
    names = [plan.components.model.label for plan in plans]
    if len({*names}) < len(names):
        raise UserError("a model is named twice; name each model once.")
    trained = {
        name: train_model(plan, terminal)[0] for name, plan in zip(names, plans, strict=True)
    }
    seen = {
        name: [
            blinded(frame)
            for frame_set in plan.frames.test
            for frame in open_frames(frame_set, terminal).frames
        ]
        for name, plan in zip(names, plans, strict=True)
    }
    facts = environment_facts()
    with terminal.task("time", 2 + len(BATCHES)) as advance:
        speeds = time_models(trained, seen, calls=calls, advance=advance)
    terminal.out.print(
        f"{plans[0].spec.id} on {plans[0].device}; {facts['cpu']}, fingerprint "
        f"{facts['fingerprint']}",
        soft_wrap=True,
    )
    rows = [{"model": name, **row} for name, found in speeds.items() for row in found.rows]
    # Models stand below each other: what differs is compared in turns.
    by_call = sorted(
        rows, key=lambda row: (row["scenario"] != "single", row["threads"], row["batch"])
    )
    timed = [(row.pop("model"), SpeedRow(**row)) for row in map(dict, by_call)]
    print_table(terminal.out, speed_table(timed))
    save_json(json_file, {"environment": facts, "speed": rows})
