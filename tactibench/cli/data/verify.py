"""``tactibench data verify``: is every sample what it was when it was written?"""

from __future__ import annotations

from pathlib import Path

import click

from tactibench.cli.options import json_option

SHOWN = 20
"""Findings that are printed; --json has all."""


@click.command()
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path, file_okay=False))
@json_option
@click.pass_context
def verify(ctx: click.Context, folder: Path, json_file: Path | None) -> None:
    """Read, hash and decode every image of a data set, and check its journals, plan and splits.

    Nothing is changed. Exit code 1 when something is not as it was written.
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import count_samples
    from tactibench.datasets import verify as check
    from tactibench.records.files import write_json

    terminal = Terminal()
    count = count_samples(folder)
    with terminal.task("verify", count) as advance:
        findings = check(folder, advance)
    for finding in findings[:SHOWN]:
        terminal.say(finding)
    if len(findings) > SHOWN:
        terminal.say(f"... and {len(findings) - SHOWN:,} more; --json FILE has all of them")
    verdict = f"{len(findings):,} findings" if findings else "all as it was written"
    terminal.say(f"{folder}: {count:,} samples, {verdict}")
    if json_file is not None:
        rows = [
            {"metric": "samples", "group": "all", "value": count, "unit": "samples"},
            {"metric": "findings", "group": "all", "value": len(findings), "unit": "findings"},
        ]
        write_json(json_file, {"findings": findings, "metrics": rows})
    if findings:
        ctx.exit(1)
