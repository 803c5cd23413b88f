"""``tactibench verify``: submissions, scored again without trusting them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from tactibench.cli.options import json_option


@click.command()
@click.argument(
    "files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE..."
)
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="Folder of the recorded frames that were tested.",
)
@click.option("--hidden", is_flag=True, help="Their presses are from TACTIBENCH_HIDDEN_SEED.")
@json_option
@click.pass_context
def verify(
    ctx: click.Context,
    files: tuple[Path, ...],
    data: Path | None,
    hidden: bool,
    json_file: Path | None,
) -> None:
    """Score the predictions beside committed records (submissions/PROTOCOL/NAME.json) again.

    The truth is made anew by this installation; nothing of the submitter's is imported. Exit code 1
    when a file is refused.
    """
    from tactibench.board.verifying.truth import Source, trusted_host
    from tactibench.board.verifying.verdict import metric_rows
    from tactibench.board.verifying.verdict import verify as check
    from tactibench.cli.output import Terminal
    from tactibench.cli.report.verify import print_verdict
    from tactibench.errors import UserError
    from tactibench.records.cache import cache_folder
    from tactibench.records.files import write_json
    from tactibench.run.components import data_folder

    source = Source(trusted_host(), cache_folder(), data_folder(data))
    terminal = Terminal()
    rows: list[dict[str, Any]] = []
    refused = 0
    for path in files:
        try:
            with terminal.task(f"verify {path.stem[:60]}", 1) as advance:
                verdict = check(path, source, hidden=hidden)
                advance(1)
        except UserError as error:
            refused += 1
            reason = " ".join(str(error).split())
            terminal.say(f"REFUSED {path.name}: {reason}")
            rows.append({"file": path.name, "state": "refused", "reason": reason})
            continue
        print_verdict(terminal.out, verdict)
        rows += metric_rows(verdict)
    if json_file is not None:
        write_json(json_file, rows)
    if len(files) > 1:
        terminal.say(f"{len(files) - refused:,} of {len(files):,} verified")
    if refused:
        ctx.exit(1)
