"""``tactibench run``."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench.cli.options import json_option, out_option


@click.command()
@click.argument("protocol")
@click.option("--model", required=True, help="Model to score; mean and nearest are baselines.")
@click.option("--regime", help="Frames handed to training; default: the protocol's first.")
@click.option("--sensor", help="Sensor that makes the frames; default: the protocol's.")
@click.option("--encoder", help="Heatmap encoder, for models that use one.")
@click.option("--data", type=click.Path(path_type=Path), help="Folder of recorded frames.")
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of training."
)
@click.option(
    "--device", type=click.Choice(["auto", "cpu", "cuda"]), default="auto", show_default=True
)
@click.option(
    "--param", "params", multiple=True, metavar="KIND.NAME=VALUE", help="Set a parameter."
)
@click.option(
    "--quick", is_flag=True, help="200 presses, 2 epochs, 40 tests: only proves the path."
)
@click.option("--limit", type=click.IntRange(min=1), help="Score at most this many test presses.")
@click.option(
    "--presses",
    type=click.IntRange(min=1),
    help="Learn from so many presses only; such a run is for the learning curve.",
)
@json_option
@out_option
@click.option("--fresh", is_flag=True, help="Predict, time and score again, even if stored.")
@click.option("--dry-run", is_flag=True, help="Print the plan and stop.")
def run(
    protocol: str,
    model: str,
    regime: str | None,
    sensor: str | None,
    encoder: str | None,
    data: Path | None,
    seed: int,
    device: str,
    params: tuple[str, ...],
    quick: bool,
    limit: int | None,
    presses: int | None,
    json_file: Path | None,
    out: Path,
    fresh: bool,
    dry_run: bool,
) -> None:
    """Run PROTOCOL (exp1, exp2, exp3, surface, or a .toml file) with a model and score it.

    Frames and weights are cached and shared; an interrupted run continues by the same command.
    """
    from tactibench.cli.output import Terminal, show_run
    from tactibench.plugins.host import PluginHost
    from tactibench.protocols.loader import check_metrics
    from tactibench.records.cache import cache_folder
    from tactibench.records.files import write_json
    from tactibench.records.store import RECORD, open_run
    from tactibench.running.plan import make_plan, plan_lines
    from tactibench.running.request import RunRequest, read_parameters

    request = RunRequest(
        protocol, model, regime, sensor, encoder, data, seed, device,
        read_parameters(params), quick, limit, presses,
    )  # fmt: skip
    terminal = Terminal()
    plan = make_plan(request, PluginHost(), cache_folder())
    stored = not fresh and (out / plan.name / RECORD).is_file()
    if not stored:
        check_metrics(plan.protocol)
    for line in plan_lines(plan, stored):
        terminal.say(line)
    if dry_run:
        return
    if stored:
        finished = open_run(out, plan.name)
    else:
        from tactibench.running.run import execute

        finished = execute(plan, out, terminal, fresh=fresh)
    show_run(terminal, finished, out)
    if json_file is not None:
        write_json(json_file, finished.record)
