"""The table of ``tactibench board time``: one line for each model and number of threads."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from rich.console import Console
from rich.text import Text

from tactibench.board import settled_time
from tactibench.records import Record, SpeedRow
from tactibench.report.labels import fixed, plural
from tactibench.report.tables import Cell, Column, Number, Table, print_table, table
from tactibench.run import QUIET


def print_times(console: Console, records: Sequence[Record], earlier: Sequence[Record]) -> None:
    """Print the times of one frame of all models, and the reasons why some are not settled.

    Args:
        console: Console to print on.
        records: Records with their new times.
        earlier: The same records with the times that are replaced.
    """
    print_table(console, times_table(records))
    for record in records:
        for row in _single(record):
            if not settled_time(row):
                threads = plural(row.threads, "thread")
                text = f"NOT SETTLED: {record.name}, {threads}: {disturbance(row)}"
                console.print(Text(text, style="yellow"), soft_wrap=True)
    pairs = zip(earlier, records, strict=True)
    ratios = [ratio for pair in pairs if (ratio := slowdown(*pair)) is not None]
    if ratios:
        console.print(
            f"processor time of a frame, divided by that of the last settled timing: median "
            f"{median(ratios):.2f}, {min(ratios):.2f} to {max(ratios):.2f}, "
            f"{plural(len(ratios), 'model')}",
            soft_wrap=True,
        )
    if ratios and abs(median(ratios) - 1) > QUIET:
        text = (
            "NOT COMPARABLE: the machine computes faster or slower than then, which no counter "
            "shows; times of then and now do not belong in one table, so time all runs of a board "
            "in one job"
        )
        console.print(Text(text, style="yellow"), soft_wrap=True)


def slowdown(before: Record, after: Record) -> float | None:
    """Return the processor time of one frame on one thread, divided by that of before.

    None where the time of before is not settled, either was not measured, or another configuration
    was timed.
    """
    if before.timed.configuration != after.timed.configuration:
        return None
    then, now = (next((r for r in _single(one) if r.threads == 1), None) for one in (before, after))
    if then is None or now is None or not settled_time(then) or not then.cpu_ms or not now.cpu_ms:
        return None
    return now.cpu_ms / then.cpu_ms


def times_table(records: Sequence[Record]) -> Table:
    """Return the table of times, the fastest model first."""
    numbers = ("p50 ms", "p90 ms", "processor/wall", "stolen, %", "foreign, %", "load")
    rows: list[list[Cell]] = []
    for record in sorted(records, key=lambda one: min(r.p50_ms for r in _single(one))):
        for row in _single(record):
            shares = [None if s is None else 100 * s for s in (row.stolen, row.foreign)]
            values = [row.p50_ms, row.p90_ms, processor_share(row), *shares, row.load]
            cells = ["n/a" if v is None else Number(v, fixed(2)) for v in values]
            rows.append(
                [record.name, str(row.threads), *cells, "yes" if settled_time(row) else "no"]
            )
    return table(["run", "threads", *map(Column, numbers), "settled"], rows)


def processor_share(row: SpeedRow) -> float | None:
    """Return processor time over wall time of a row; None where it was not measured."""
    return None if row.cpu_ms is None or not row.mean_ms else row.cpu_ms / row.mean_ms


def disturbance(row: SpeedRow) -> str:
    """Return the reason why the times of a row are not settled, in words."""
    share = processor_share(row)
    if share is None:
        return "processor time was not measured"
    if share < 1 - QUIET:
        return f"the process computed for {100 * share:.0f} % of the time"
    others = (row.stolen or 0.0) + (row.foreign or 0.0)
    if row.threads == 1 and share > 1 + QUIET:
        return f"the process computed on {share:.1f} threads"
    if others > QUIET:
        return f"others took {100 * others:.0f} % of the processors"
    return "they still drifted after the warm-up"


def _single(record: Record) -> list[SpeedRow]:
    return [r for r in record.speed if (r.scenario, r.phase) == ("single", "total")]
