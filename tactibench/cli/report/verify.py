"""What ``tactibench board verify`` says of a submission that was not refused."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from tactibench.board.verifying.verdict import Verdict
from tactibench.cli.report.cells import estimate, print_grid
from tactibench.cli.report.words import NAMES
from tactibench.records.record import Metric


def print_verdict(console: Console, verdict: Verdict) -> None:
    """The name, what was computed anew, and what rests on the submitter's word."""
    record = verdict.record
    console.print(Text(f"VERIFIED {verdict.path.name}", style="bold"), soft_wrap=True)
    console.print(Text(f"  {verdict.subject}"), soft_wrap=True)
    console.print(
        Text(
            f"  {record.protocol.label}: truth of "
            f"{verdict.frames:,} test frames made again, predictions "
            f"{record.identity.predictions_hash[:12]}, {len(verdict.again)} metric rows equal"
        ),
        soft_wrap=True,
    )
    rows = [
        (
            f"  {_name(row)}",
            row.group,
            estimate(row, 2 if row.unit == "share" else 4),
            f"{row.clusters:,}",
        )
        for row in verdict.headline()
    ]
    print_grid(
        console,
        ("  metric", "group", "value [95 %]", "presses"),
        rows,
        right=frozenset({"presses"}),
    )
    told = ["times", "training", "weights", *(NAMES.get(n, n) for n in verdict.stated)]
    console.print(
        Text(f"  on the submitter's word: {', '.join(told)}", style="dim"), soft_wrap=True
    )


def _name(row: Metric) -> str:
    unit = {"share": ", %", "mm": ", mm", "deg": ", deg"}.get(row.unit, "")
    return f"{NAMES.get(row.metric, row.metric)}{unit}"
