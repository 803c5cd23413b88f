"""``tactibench score``."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench.cli.completion import RUN
from tactibench.cli.options import json_option, save_json, store_option


@click.command()
@click.argument("run_name", metavar="RUN", type=RUN)
@store_option
@json_option
@click.pass_context
def score(ctx: click.Context, run_name: str, store: Path, json_file: Path | None) -> None:
    """Score the stored predictions of RUN (a name in the store, or a folder) again.

    Neither model nor sensor is used. Says whether the numbers equal the stored ones; exit code 1
    when they do not.
    """
    from tactibench.cli.output import Terminal, show_run
    from tactibench.records.store import StoredRun, open_run
    from tactibench.run.score import metric_differences, rescore

    terminal = Terminal()
    run = open_run(store, run_name)
    record = rescore(run)
    show_run(terminal, StoredRun(run.folder, record), store)
    changed = metric_differences(run.record.metrics, record.metrics)
    save_json(json_file, record.json_values())
    if changed:
        for line in changed[:20]:
            terminal.say(line)
        ctx.exit(1)
    terminal.say(f"scored again: all {len(record.metrics)} rows are identical to the stored ones")
