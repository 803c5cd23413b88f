"""The report of ``tactibench board verify`` on a submission that was not refused."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from tactibench.board import BELOW_BOUND, Verdict
from tactibench.report.labels import NAMES, named
from tactibench.report.tables import Column, metric_number, print_table, table


def print_verdict(console: Console, verdict: Verdict) -> None:
    """Print the name, what was computed anew, and what rests on the submitter's word alone."""
    record = verdict.record
    lines = (
        f"VERIFIED {verdict.path.name}",
        f"  {verdict.subject}",
        f"  {record.protocol.id}@{record.protocol.version}: truth of "
        f"{verdict.frames:,} test frames made again, predictions "
        f"{record.identity.predictions_hash[:12]}, {len(verdict.again)} metric rows equal",
        f"  it {verdict.neighbours.note}",
    )
    for number, line in enumerate(lines):
        console.print(Text(line, style="" if number else "bold"), soft_wrap=True)
    rows = [
        (
            f"  {named(row.metric, row.unit)}",
            row.group,
            metric_number(row, 2 if row.unit == "share" else 4),
            f"{row.clusters:,}",
        )
        for row in verdict.headline()
    ]
    print_table(console, table(("  metric", "group", "value [95 %]", Column("presses")), rows))
    for row in verdict.below_bound():
        text = f"  BELOW the Cramer-Rao bound: {named(row.metric, '')} of {row.group} is "
        console.print(Text(f"{text}{row.value:.3g}; {BELOW_BOUND}", style="bold"), soft_wrap=True)
    stated = [NAMES.get(name, name) for name in verdict.stated]
    text = f"  on the submitter's word: {', '.join(stated)}"
    console.print(Text(text, style="dim"), soft_wrap=True)
