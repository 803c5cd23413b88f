"""``tactibench score``."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench.cli.completion import RUN
from tactibench.cli.options import board_option, full_option, json_option, save_json, store_option


@click.command()
@click.argument("run_name", metavar="RUN", type=RUN)
@store_option
@board_option
@full_option
@json_option
@click.pass_context
def score(
    ctx: click.Context,
    run_name: str,
    store: Path,
    board_folder: Path,
    full: bool,
    json_file: Path | None,
) -> None:
    """Score the stored predictions of RUN (a name in the store, or a folder) again.

    Neither model nor sensor is used. Says whether the numbers equal the stored ones; exit code 1
    when they do not. Answers that had no score yet are scored, and their run is stored.
    """
    from tactibench import api
    from tactibench.cli.output import Terminal, show_run

    terminal = Terminal()
    scored = api.score(run_name, store)
    show_run(terminal, scored.run, store, board_folder, full=full)
    record = scored.run.record
    save_json(json_file, record.json_values())
    if scored.completed:
        terminal.say(f"scored: {len(record.metrics)} rows; the run is now in the store")
        return
    if scored.differences:
        for line in scored.differences[:20]:
            terminal.say(line)
        ctx.exit(1)
    terminal.say(f"scored again: all {len(record.metrics)} rows are identical to the stored ones")
