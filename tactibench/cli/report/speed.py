"""Speed beside error: latency by phase and threads, and what the timed configuration changes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.text import Text

from tactibench.board.published import PublishedTable, rows_for
from tactibench.cli.report.cells import Cells, Row, estimate, number, print_grid
from tactibench.cli.report.origin import Record
from tactibench.cli.report.words import HEADLINES, NAMES

KEYS = ("scenario", "batch", "threads")
TIMES = ("p50_ms", "p90_ms", "p99_ms")


def print_speed(console: Console, record: Record, published: Sequence[PublishedTable]) -> None:
    """Print the headline error with its cost, then every timed phase."""
    environment, rows = record["environment"], record.get("speed") or []
    console.print()
    console.print(Text("Speed beside error", style="bold"))
    for line in _headline(record, rows):
        console.print(Text(line))
    console.print(Text(f"{environment['cpu']}, {_threads(environment['threads'])}, "
                       f"fingerprint {environment['fingerprint']}", style="dim"))  # fmt: skip
    if rows:
        heads = [*KEYS, "phase", "p50 ms", "p90 ms", "p99 ms", "frames/s"]
        print_grid(console, heads, _phases(rows), right=frozenset(heads[-4:]))
    if not all(row["settled"] for row in rows):
        console.print(Text("NOT SETTLED: times still drifted after the warm-up", style="yellow"))
    if rows and not any(row["scenario"] == "offline" for row in rows):
        console.print(Text("offline (larger batches): none, not timed by this run", style="dim"))
    timed = record.get("timed")
    if rows and timed:
        console.print(Text(_timed(timed)))
    for table in published:
        for row in rows_for(record["protocol"]["id"], table):
            if row.speed:
                console.print(Text(
                    f"published: {row.label}, {row.speed.phase} {row.speed.per_s:g} per s on "
                    f"{row.speed.hardware}, another machine", style="magenta"
                ))  # fmt: skip


def _timed(timed: Row) -> str:
    """What was timed, and how far its answers are from those that were scored."""
    gap, changed = timed["difference_mm"], timed.get("frames_with_another_count")
    text = f"timed: {timed['configuration']}; difference to the float32 answers that were scored: "
    text += "n/a" if gap is None else f"{number(gap, 4)} mm"
    if changed:
        text += f", and another number of contacts in {changed:,} of {timed['frames']:,} frames"
    return text


def _phases(rows: Sequence[Row]) -> Iterable[Cells]:
    last: Cells = ()
    for row in rows:
        key = tuple(str(row[name]) for name in KEYS)
        rate = f"{row['per_s']:,.0f}" if row["phase"] == "total" else ""
        times = (number(row[name], 2) for name in TIMES)
        yield (*(("", "", "") if key == last else key), row["phase"], *times, rate)
        last = key


def _headline(record: Record, rows: Sequence[Row]) -> Iterable[str]:
    """The error that ranks, the share that qualifies it, and the latency of one frame."""
    protocol = record["protocol"]["id"]
    if protocol in HEADLINES:
        metric, group, qualifier, decimals = HEADLINES[protocol]
        found = {(row["metric"], row["group"]): row for row in record["metrics"]}
        error = estimate(found.get((metric, group)), decimals)
        share = estimate(found.get((qualifier, "all")), 1)
        unit, percent = "" if error == "n/a" else " mm", "" if share == "n/a" else " %"
        yield f"{NAMES[metric]} {error}{unit}"
        yield f"{NAMES[qualifier]} {share}{percent}"
    times = [
        f"{number(row['p90_ms'], 2)} ms on {_threads(row['threads'])}"
        for row in rows
        if row["scenario"] == "single" and row["phase"] == "total"
    ]
    yield f"one frame to contacts, p90: {', '.join(times) or 'not timed'}"


def _threads(count: int) -> str:
    return f"{count} thread" if count == 1 else f"{count} threads"
