"""``tactibench speed``: models timed in turns, from trained weights."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import json_option, request_of, request_options, save_json
from tactibench.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from tactibench.report import Cell
    from tactibench.run import Speed


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
    from tactibench.records import cache_folder
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
    _print_speeds(terminal.out, speeds)
    rows = [{"model": name, **row} for name, found in speeds.items() for row in found.rows]
    save_json(json_file, {"environment": facts, "speed": rows})


def _print_speeds(console: Console, speeds: Mapping[str, Speed]) -> None:
    """Print the times of a frame by model and threads, and the frames per second by batch."""
    from tactibench.report import Column, Number, fixed, print_table, table

    single: list[list[Cell]] = []
    offline: list[list[Cell]] = []
    unsettled = False
    for name, found in speeds.items():
        totals = [row for row in found.rows if row["phase"] == "total"]
        unsettled |= not all(row["settled"] for row in totals)
        for total in (row for row in totals if row["scenario"] == "single"):
            phases = [
                f"{row['phase']} {row['p50_ms']:.2f}"
                for row in found.rows
                if (row["scenario"], row["threads"]) == ("single", total["threads"])
                and row["phase"] != "total"
            ]
            times = [total[key] for key in ("p50_ms", "p90_ms", "p99_ms", "cpu_ms")]
            numbers = [Number(value, fixed(2)) for value in times]
            single.append([name, str(total["threads"]), *numbers, ", ".join(phases)])
        rates = [row for row in totals if row["scenario"] == "offline"]
        offline.append([name, *(Number(row["per_s"], fixed(0)) for row in rates)])
    columns = map(Column, ("threads", "p50", "p90", "p99", "processor"))
    print_table(
        console,
        table(["model", *columns, "p50 by phase"], single, title="one frame to contacts, ms"),
    )
    batches = (Column(str(row["batch"])) for row in rates)
    print_table(console, table(["model", *batches], offline, title="frames/s by batch"))
    if unsettled:
        console.print(
            "NOT SETTLED: some times still drifted, or something else computed meanwhile",
            style="yellow",
            soft_wrap=True,
        )
