"""Speed beside error: latency by phase and threads, and the effect of the timed configuration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.text import Text

from tactibench.board import settled_time
from tactibench.protocols import BoardSpec, PublishedTable, rows_for
from tactibench.records import Record, SpeedRow
from tactibench.report.labels import NAMES
from tactibench.report.numbers import fixed, number, plural
from tactibench.report.table import Cell, Column, Head, Number, Table, metric_number, table
from tactibench.report.writers.terminal import print_table


def print_speed(
    console: Console, record: Record, spec: BoardSpec, published: Sequence[PublishedTable]
) -> None:
    """Print the error with the share that qualifies it beside the speed, then every timed phase.

    Args:
        console: Console to print on.
        record: Record of the run.
        spec: Tables of the protocol.
        published: Tables of papers, whose speeds are printed last.
    """
    facts = record.environment
    console.print()
    console.print(Text("Speed beside error", style="bold"))
    for line in _headline(record, spec):
        console.print(Text(line))
    machine = f"{facts.cpu}, {plural(facts.threads, 'thread')}, fingerprint {facts.fingerprint}"
    console.print(Text(machine, style="dim"))
    if record.speed:
        print_table(console, _phases(record.speed))
        for line, style in _remarks(record):
            console.print(Text(line, style=style))
    if record.efficiency:
        console.print(Text(_cost(record)))
    for paper in published:
        for row in rows_for(record.protocol.id, paper):
            if row.speed:
                text = (
                    f"published: {row.label}, {row.speed.phase} {row.speed.per_s:g} per s on "
                    f"{row.speed.hardware}, another machine"
                )
                console.print(Text(text, style="magenta"))


def change(relative: float) -> str:
    """Return a relative change in per cent with its sign, such as "+0.3 %"."""
    return f"{100 * relative:+.1f} %"


def _headline(record: Record, spec: BoardSpec) -> Iterator[str]:
    """Yield the error, the share that qualifies it, and the latency of one frame."""
    if spec.headline is not None:
        metrics = {(metric.metric, metric.group): metric for metric in record.metrics}
        shown = (
            (spec.headline.metric, spec.headline.group, spec.headline.decimals, "mm"),
            (spec.headline.qualifier, "all", 1, "%"),
        )
        for name, group, decimals, unit in shown:
            value = metric_number(metrics.get((name, group)), decimals)
            yield f"{NAMES[name]} {'n/a' if value is None else f'{value} {unit}'}"
    times = [
        f"{number(row.p90_ms, 2)} ms on {plural(row.threads, 'thread')}"
        for row in record.speed
        if row.scenario == "single" and row.phase == "total"
    ]
    yield f"one frame to contacts, p90: {', '.join(times) or 'not timed'}"


def _phases(speed: Sequence[SpeedRow]) -> Table:
    """Return the times of every phase for single frames, and of the whole call for batches."""
    rows: list[list[Cell]] = []
    last: tuple[str, ...] = ()
    for row in speed:
        if row.scenario == "offline" and row.phase != "total":
            continue
        key = (row.scenario, str(row.batch), str(row.threads))
        times = (Number(value, fixed(2)) for value in (row.p50_ms, row.p90_ms, row.p99_ms))
        rate = f"{row.per_s:,.0f}" if row.phase == "total" else ""
        rows.append([*(("", "", "") if key == last else key), row.phase, *times, rate])
        last = key
    times_heads = map(Column, ("p50 ms", "p90 ms", "p99 ms", "frames/s"))
    heads: list[Head] = ["scenario", "batch", "threads", "phase", *times_heads]
    return table(heads, rows)


def _remarks(record: Record) -> Iterator[tuple[str, str]]:
    """Yield sentences about the times, each with its style."""
    unsettled = dict.fromkeys(
        f"{row.scenario} (batch {row.batch}, {plural(row.threads, 'thread')})"
        for row in record.speed
        if not settled_time(row)
    )
    if unsettled:
        names = ", ".join(unsettled)
        text = f"NOT SETTLED: times of {names} still drifted, or something else computed meanwhile"
        yield text, "yellow"
    if not any(row.scenario == "offline" for row in record.speed):
        yield "offline (larger batches): none, not timed by this run", "dim"
    timed = record.timed
    if timed.configuration is None:
        return
    gap = "n/a" if timed.difference_mm is None else f"{number(timed.difference_mm, 4)} mm"
    text = f"timed: {timed.configuration}; difference to the float32 answers that were scored: "
    text += gap
    if timed.error_change is not None:
        text += f" (mean error {change(timed.error_change)})"
    if timed.frames_with_another_count:
        text += (
            f", and another number of contacts in {timed.frames_with_another_count:,} of "
            f"{timed.frames:,} frames"
        )
    yield text, ""
    if len(timed.raced) > 1:
        choices = (
            f"{number(choice.p50_ms or 0, 2)} ms {choice.configuration}" for choice in timed.raced
        )
        yield f"chosen from, p50 on 1 thread: {'; '.join(choices)}", "dim"


def _cost(record: Record) -> str:
    cost = record.efficiency
    flops, memory = cost.flops_per_frame, cost.peak_memory_mb
    parts = [
        "weights n/a" if cost.parameters is None else f"{cost.parameters:,} weights",
        "operations n/a" if flops is None else f"{1e-9 * flops:.3g} GFLOP a frame",
        "peak memory n/a" if memory is None else f"peak memory of the process {memory:,.0f} MB",
    ]
    if cost.training_s is not None:
        parts.append(f"training {cost.training_s:,.0f} s")
    return f"cost: {', '.join(parts)}"
