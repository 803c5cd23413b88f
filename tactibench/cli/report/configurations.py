"""The table of ``tactibench speed``: one line per way to compute, the best one marked."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console
from rich.text import Text

from tactibench.board.numbers import number
from tactibench.cli.report.cells import Cells, print_grid
from tactibench.cli.report.speed import change
from tactibench.run.race import Race

ABSENT = "n/a"


def print_race(console: Console, race: Race, subject: str, note: str) -> None:
    """Print latencies by phase, frames per second by batch, accuracy, and what was left out."""
    console.print(Text(subject, style="bold"))
    threads = sorted({row["threads"] for row in race.rows if row["scenario"] == "single"})
    phases = [row["phase"] for row in race.rows if _first(race, row)]
    console.print(Text("\none frame to contacts, ms", style="bold"))
    heads = [
        "configuration",
        "threads",
        *(f"{phase} p50" for phase in phases[:-1]),
        "p50",
        "p90",
        "p99",
    ]
    print_grid(console, heads, _latencies(race, threads, phases), right=frozenset(heads[1:]))
    batches = sorted({row["batch"] for row in race.rows if row["scenario"] == "offline"})
    if batches:
        counted = "1 thread" if max(threads) == 1 else f"{max(threads)} threads"
        console.print(Text(f"\nframes/s by batch, {counted}", style="bold"))
        heads = ["configuration", *map(str, batches)]
        print_grid(console, heads, _rates(race, max(threads), batches), right=frozenset(heads[1:]))
    console.print(Text("\nanswers beside the float32 ones", style="bold"))
    heads = ["configuration", "apart, mm", "mean error", "other count", "what it is"]
    print_grid(console, heads, _answers(race), right=frozenset(heads[1:4]))
    for name, reason in race.found.skipped.items():
        console.print(Text(f"left out: {name}: {reason.rstrip('.')}", style="dim"))
    if not all(row["settled"] for row in race.rows):
        console.print(
            Text("NOT SETTLED: some times still drifted after the warm-up", style="yellow")
        )
    if note:
        console.print(Text(note, style="yellow"))
    console.print(Text(f"\n{verdict(race)}"))


def verdict(race: Race) -> str:
    """The sentence that names the default."""
    best, plain = race.total(race.best.name, 1), race.total(race.found.usable[0].name, 1)
    text = f"default here: {race.best.name} ({race.best.words})"
    if race.best is race.found.usable[0]:
        return text
    ratio = plain["p50_ms"] / best["p50_ms"]
    return f"{text}, {ratio:.2f} times as fast as {race.found.usable[0].name} on one thread"


def _first(race: Race, row: dict[str, object]) -> bool:
    name = race.found.usable[0].name
    return (row["configuration"], row["scenario"], row["threads"]) == (name, "single", 1)


def _latencies(race: Race, threads: list[int], phases: list[str]) -> Iterable[Cells]:
    for one in race.found.usable:
        for count in threads:
            rows = {
                row["phase"]: row
                for row in race.rows
                if (row["configuration"], row["scenario"], row["threads"])
                == (one.name, "single", count)
            }
            parts = (number(rows[phase]["p50_ms"], 2) for phase in phases[:-1])
            total = rows["total"]
            whole = (number(total[key], 2) for key in ("p50_ms", "p90_ms", "p99_ms"))
            yield (_marked(race, one.name), str(count), *parts, *whole)


def _rates(race: Race, threads: int, batches: list[int]) -> Iterable[Cells]:
    for one in race.found.usable:
        rows = (race.total(one.name, threads, batch, "offline") for batch in batches)
        cells = (ABSENT if row is None else f"{row['per_s']:,.0f}" for row in rows)
        yield (_marked(race, one.name), *cells)


def _answers(race: Race) -> Iterable[Cells]:
    for one in race.found.usable:
        gap = one.difference
        yield (
            _marked(race, one.name),
            ABSENT if gap.median_mm is None else number(gap.median_mm, 5),
            ABSENT if gap.error_change is None else change(gap.error_change),
            f"{gap.other_count} of {gap.frames}",
            one.words if gap.allowed else f"{one.words}; NOT ALLOWED: answers differ too much",
        )


def _marked(race: Race, name: str) -> str:
    return f"{name} *" if name == race.best.name else name
