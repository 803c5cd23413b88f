"""The reports of ``tactibench board verify`` and ``reproduce`` on a submission."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from tactibench.board import BELOW_BOUND, ReproducedMetric, ReproducedRun, Verdict
from tactibench.report.labels import named
from tactibench.report.tables import Column, metric_number, print_table, table


def print_verdict(console: Console, verdict: Verdict) -> None:
    """Print the name and what was computed anew."""
    record = verdict.record
    lines = (
        f"VERIFIED {verdict.path.name}",
        f"  {verdict.subject}",
        f"  {record.protocol.id}@{record.protocol.version}: truth of "
        f"{verdict.frames:,} test frames made again, predictions "
        f"{record.identity.predictions_hash[:12]}, {len(verdict.again)} metric rows equal",
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
    text = "  all else is its submitter's word until the run is made again (`board reproduce`)"
    console.print(Text(text, style="dim"), soft_wrap=True)


MOST_SHOWN = 20
"""Most metrics out of tolerance that are printed; --json holds all."""


def print_reproduction(console: Console, run: ReproducedRun) -> None:
    """Print the metrics that decide, beside those of the record, and the others out of tolerance.

    Args:
        console: The console.
        run: A record and the run made again.
    """
    outside = [one for one in run.metrics if not (one.within or one.decides)]
    shown = [*(one for one in run.metrics if one.decides), *outside[:MOST_SHOWN]]
    rows = [
        (
            f"  {named(one.stated.metric, one.stated.unit)}",
            one.stated.group,
            *(_value(value, one) for value in (one.stated.value, one.value)),
            " to ".join(_value(end, one) for end in (one.low, one.high)),
            ("" if one.within else "NO") if one.decides else "no (not decisive)",
        )
        for one in shown
    ]
    verb = "REPRODUCED" if run.reproduced else "NOT REPRODUCED"
    console.print(Text(f"{verb} {run.path.name}", style="bold"), soft_wrap=True)
    heads = ("  metric", "group", "record", "reproduced", "tolerance", "within")
    print_table(console, table(heads, rows))
    within = sum(one.within for one in run.metrics)
    frames = "the same test frames" if run.same_frames else "test frames with another hash"
    text = f"  {within:,} of {len(run.metrics):,} metrics within tolerance, on {frames}"
    console.print(Text(text), soft_wrap=True)


def _value(value: float | None, metric: ReproducedMetric) -> str:
    scale = 100.0 if metric.stated.unit == "share" else 1.0
    return "n/a" if value is None else f"{scale * value:.5g}"
