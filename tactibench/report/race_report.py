"""The tables of ``tactibench speed``: one line for each configuration, with the best one marked."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from tactibench.report.labels import fixed
from tactibench.report.tables import Cell, Column, Head, Number, Table, print_table, table
from tactibench.run import Race


def print_race(console: Console, race: Race, subject: str, note: str) -> None:
    """Print latencies by phase, frames per second by batch, accuracy, and what was left out.

    Args:
        console: Console to print on.
        race: Times of all configurations.
        subject: First line.
        note: Last note; "" for none.
    """
    console.print(Text(subject, style="bold"))
    for shown in (_latency_table(race), _rate_table(race), _prediction_table(race)):
        if shown is not None:
            console.print()
            print_table(console, shown)
    for name, reason in race.configurations.skipped.items():
        console.print(Text(f"left out: {name}: {reason.rstrip('.')}", style="dim"))
    if not all(row["settled"] for row in race.rows):
        text = "NOT SETTLED: some times still drifted, or something else computed meanwhile"
        console.print(Text(text, style="yellow"))
    if note:
        console.print(Text(note, style="yellow"))
    console.print(Text(f"\n{verdict(race)}"))


def verdict(race: Race) -> str:
    """Return a sentence that names the configuration chosen as default."""
    first = race.configurations.usable[0]
    text = f"default here: {race.best.name} ({race.best.description})"
    if race.best is first:
        return text
    best, plain = race.total(race.best.name, 1), race.total(first.name, 1)
    ratio = plain["p50_ms"] / best["p50_ms"]
    return f"{text}, {ratio:.2f} times as fast as {first.name} on one thread"


def _threads(race: Race) -> list[int]:
    return sorted({row["threads"] for row in race.rows if row["scenario"] == "single"})


def _latency_table(race: Race) -> Table:
    times = {
        (row["configuration"], row["threads"], row["phase"]): row
        for row in race.rows
        if row["scenario"] == "single"
    }
    first = race.configurations.usable[0].name
    phases = [phase for name, threads, phase in times if (name, threads) == (first, 1)][:-1]
    rows: list[list[Cell]] = []
    for way in race.configurations.usable:
        for threads in _threads(race):
            parts = [times[way.name, threads, phase]["p50_ms"] for phase in phases]
            total = times[way.name, threads, "total"]
            values = [*parts, *(total[key] for key in ("p50_ms", "p90_ms", "p99_ms"))]
            numbers = (Number(value, fixed(2)) for value in values)
            rows.append([_marked(race, way.name), str(threads), *numbers])
    times_heads = ["threads", *(f"{phase} p50" for phase in phases), "p50", "p90", "p99"]
    heads: list[Head] = ["configuration", *map(Column, times_heads)]
    return table(heads, rows, title="one frame to contacts, ms")


def _rate_table(race: Race) -> Table | None:
    batches = sorted({row["batch"] for row in race.rows if row["scenario"] == "offline"})
    if not batches:
        return None
    threads = max(_threads(race))
    rows: list[list[Cell]] = []
    for way in race.configurations.usable:
        totals = [race.total(way.name, threads, batch, "offline") for batch in batches]
        numbers = (None if t is None else Number(t["per_s"], fixed(0)) for t in totals)
        rows.append([_marked(race, way.name), *numbers])
    counted = "1 thread" if threads == 1 else f"{threads} threads"
    heads: list[Head] = ["configuration", *(Column(str(batch)) for batch in batches)]
    return table(heads, rows, title=f"frames/s by batch, {counted}")


def _prediction_table(race: Race) -> Table:
    rows: list[Sequence[Cell]] = []
    for way in race.configurations.usable:
        gap = way.difference
        refused = "" if gap.allowed else "; NOT ALLOWED: answers differ too much"
        rows.append(
            [
                _marked(race, way.name),
                None if gap.median_mm is None else Number(gap.median_mm, fixed(5)),
                None if gap.error_change is None else Number(gap.error_change, change),
                f"{gap.other_count} of {gap.frames}",
                f"{way.description}{refused}",
            ]
        )
    counts = map(Column, ("apart, mm", "mean error", "other count"))
    heads: list[Head] = ["configuration", *counts, "what it is"]
    return table(heads, rows, title="answers beside the float32 ones")


def _marked(race: Race, name: str) -> str:
    return f"{name} *" if name == race.best.name else name


def change(relative: float) -> str:
    """Return a relative change in per cent with its sign, such as "+0.3 %"."""
    return f"{100 * relative:+.1f} %"
