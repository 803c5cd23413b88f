"""``tactibench published``: what papers print, and whether the notes on it hold."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import board_option, json_option

if TYPE_CHECKING:
    from tactibench.board.claims import Checked
    from tactibench.board.published import Finding, PublishedTable


@click.group()
def published() -> None:
    """Published tables: TOML files with their source under leaderboards/published."""


@published.command("list")
@board_option
@json_option
def listing(board_folder: Path, json_file: Path | None) -> None:
    """List the rows of every published table."""
    from tactibench.cli.output import Terminal
    from tactibench.cli.report.cells import print_grid
    from tactibench.records.files import write_json

    terminal = Terminal()
    rows: list[dict[str, Any]] = []
    for table in _tables(board_folder, ()):
        terminal.say(f"{table.name}: {table.authors}, {table.title}, {table.year}")
        terminal.say(f"  measured on: {table.measured_on}")
        cells = []
        for number, row in enumerate(table.rows, 1):
            values = [
                (metric, group, value)
                for metric, groups in row.metrics.items()
                for group, value in groups.items()
            ]
            rows += [
                {
                    "table": table.name,
                    "protocol": row.protocol,
                    "model": row.model,
                    "regime": row.regime,
                    "source": row.source,
                    "metric": metric,
                    "group": group,
                    "value": value,
                    "n": row.n,
                    "unit": _unit(metric),
                    "comparable": row.comparable,
                }
                for metric, group, value in values
            ]
            n = f"{row.n:,} {row.unit}" if row.n else "n/a"
            cells.append(
                (f"  {number}", row.protocol, row.label, ", ".join(row.metrics), n, row.comparable)
            )
        heads = ("  row", "protocol", "model", "metrics", "n", "comparable")
        print_grid(terminal.out, heads, cells)
    if json_file is not None:
        write_json(json_file, rows)


@published.command()
@click.argument("names", nargs=-1, metavar="[TABLE...]")
@board_option
@json_option
@click.pass_context
def check(
    ctx: click.Context, names: tuple[str, ...], board_folder: Path, json_file: Path | None
) -> None:
    """Compute again what the notes on published tables say, a finding a line.

    Then what the printed values imply beyond the notes. Exit code 1 when a note disagrees with its
    own table.
    """
    from tactibench.board.claims import check_claims, implied, unclaimed
    from tactibench.records.files import write_json

    rows: list[dict[str, Any]] = []
    wrong = 0
    for table in _tables(board_folder, names):
        claims, findings = check_claims(table), implied(table)
        wrong += sum(not checked.agrees for checked in claims)
        for checked in claims:
            click.echo(_claim_line(table.name, checked))
        for note, number in unclaimed(table):
            click.echo(f"{table.name}: note {note} says {number}: stated, not computed")
        for finding in findings:
            click.echo(f"{table.name}: {_finding(finding)}")
        rows += [
            *(_claim_row(table.name, one) for one in claims),
            *(_finding_row(table.name, one) for one in findings),
        ]
    if json_file is not None:
        write_json(json_file, rows)
    if wrong:
        plural = "s" if wrong > 1 else ""
        click.echo(
            f"{wrong} figure{plural} in the notes are not what the tables give; mend the "
            "note or the row.",
            err=True,
        )
        ctx.exit(1)
    click.echo("every computed figure in the notes is what the tables give")


def _tables(board: Path, names: tuple[str, ...]) -> list[PublishedTable]:
    from tactibench.board.published import load_published, published_names
    from tactibench.shipped import shipped_folder

    own = board / "published"
    folder = own if own.is_dir() else shipped_folder("published")
    return load_published(names or published_names(folder), folder)


def _claim_line(table: str, checked: Checked) -> str:
    claim = checked.claim
    text = f"{table}: note {claim.note} says {claim.says}: {checked.subject}: {checked.found}"
    if not checked.in_note:
        return f"{text}: WRONG, the note does not say so"
    return text if checked.agrees else f"{text}: WRONG"


def _finding(finding: Finding) -> str:
    ends = "" if finding.low is None else f" [{finding.low:.3g}, {finding.high:.3g}]"
    unit = f" {finding.unit}" if finding.unit else ""
    note = f" ({finding.note})" if finding.note else ""
    name = f"{finding.metric}, {finding.group}"
    return f"{finding.row}: {name}: {finding.value:.4g}{ends}{unit}{note}"


def _claim_row(table: str, checked: Checked) -> dict[str, Any]:
    claim = checked.claim
    return {
        "table": table,
        "metric": claim.quantity,
        "group": claim.group or "",
        "unit": "",
        "value": checked.found,
        "says": claim.says,
        "note": claim.note,
        "row": claim.row,
        "agrees": checked.agrees,
    }


def _finding_row(table: str, finding: Finding) -> dict[str, Any]:
    import math

    ends = {
        end: value if value is not None and math.isfinite(value) else None
        for end, value in (("low", finding.low), ("high", finding.high))
    }
    return {
        "table": table,
        "row": finding.row,
        "metric": finding.metric,
        "group": finding.group,
        "value": finding.value,
        "unit": finding.unit,
        **ends,
        "note": finding.note,
    }


def _unit(metric: str) -> str:
    return next((u for end, u in (("_mm", "mm"), ("_deg", "deg")) if metric.endswith(end)), "")
