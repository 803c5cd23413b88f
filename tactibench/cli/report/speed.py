"""Speed beside error: latency by phase and threads, and what the timed configuration changes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.text import Text

from tactibench.board.numbers import number
from tactibench.board.published import PublishedTable, rows_for
from tactibench.cli.report.cells import Cells, estimate, print_grid
from tactibench.cli.report.words import HEADLINES, NAMES
from tactibench.records.record import Configuration, Efficiency, Record, SpeedRow, Timed

KEYS = ("scenario", "batch", "threads")
TIMES = ("p50_ms", "p90_ms", "p99_ms")


def print_speed(console: Console, record: Record, published: Sequence[PublishedTable]) -> None:
    """Print the headline error with its cost, then every timed phase."""
    environment, rows = record.environment, record.speed
    console.print()
    console.print(Text("Speed beside error", style="bold"))
    for line in _headline(record, rows):
        console.print(Text(line))
    console.print(
        Text(
            f"{environment.cpu}, {_threads(environment.threads)}, "
            f"fingerprint {environment.fingerprint}",
            style="dim",
        )
    )
    if rows:
        heads = [*KEYS, "phase", "p50 ms", "p90 ms", "p99 ms", "frames/s"]
        print_grid(console, heads, _phases(rows), right=frozenset(heads[-4:]))
    drifted = _drifted(rows)
    if drifted:
        console.print(
            Text(
                f"NOT SETTLED: times of {', '.join(drifted)} still drifted after the warm-up",
                style="yellow",
            )
        )
    if rows and not any(row.scenario == "offline" for row in rows):
        console.print(Text("offline (larger batches): none, not timed by this run", style="dim"))
    timed = record.timed
    if rows and timed:
        console.print(Text(_timed(timed)))
        for line in _raced(timed):
            console.print(Text(line, style="dim"))
    if record.efficiency:
        console.print(Text(_cost(record.efficiency)))
    for table in published:
        for row in rows_for(record.protocol.id, table):
            if row.speed:
                console.print(
                    Text(
                        f"published: {row.label}, {row.speed.phase} {row.speed.per_s:g} per s on "
                        f"{row.speed.hardware}, another machine",
                        style="magenta",
                    )
                )


def _timed(timed: Configuration) -> str:
    """What was timed, and how far its answers are from those that were scored."""
    gap, changed = timed.difference_mm, timed.frames_with_another_count
    text = f"timed: {timed.configuration}; difference to the float32 answers that were scored: "
    text += "n/a" if gap is None else f"{number(gap, 4)} mm"
    if timed.error_change is not None:
        text += f" (mean error {change(timed.error_change)})"
    if changed:
        text += f", and another number of contacts in {changed:,} of {timed.frames:,} frames"
    return text


def _raced(timed: Timed) -> Iterable[str]:
    """The ways to compute that the timed one was chosen from."""
    if len(timed.raced) > 1:
        found = "; ".join(
            f"{number(one.p50_ms or 0.0, 2)} ms {one.configuration}" for one in timed.raced
        )
        yield f"chosen from, p50 on 1 thread: {found}"


def _cost(efficiency: Efficiency) -> str:
    """Weights, operations, memory and training time in one line."""
    weights, flops = efficiency.parameters, efficiency.flops_per_frame
    memory, training = efficiency.peak_memory_mb, efficiency.training_s
    parts = [
        "weights n/a" if weights is None else f"{weights:,} weights",
        "operations n/a" if flops is None else f"{1e-9 * flops:.3g} GFLOP a frame",
        "peak memory n/a" if memory is None else f"peak memory of the process {memory:,.0f} MB",
    ]
    if training is not None:
        parts.append(f"training {training:,.0f} s")
    return f"cost: {', '.join(parts)}"


def change(relative: float) -> str:
    """A relative change in per cent with its sign, such as "+0.3 %"."""
    return f"{100 * relative:+.1f} %"


def _drifted(rows: Sequence[SpeedRow]) -> list[str]:
    """Scenarios whose warm-up did not end by itself."""
    found = {
        f"{row.scenario} (batch {row.batch}, {_threads(row.threads)})": None
        for row in rows
        if not row.settled
    }
    return list(found)


def _phases(rows: Sequence[SpeedRow]) -> Iterable[Cells]:
    """Every phase of single frames; of batches the whole call."""
    last: Cells = ()
    for row in rows:
        if row.scenario == "offline" and row.phase != "total":
            continue
        key = tuple(str(getattr(row, name)) for name in KEYS)
        rate = f"{row.per_s:,.0f}" if row.phase == "total" else ""
        times = (number(getattr(row, name), 2) for name in TIMES)
        yield (*(("", "", "") if key == last else key), row.phase, *times, rate)
        last = key


def _headline(record: Record, rows: Sequence[SpeedRow]) -> Iterable[str]:
    """The error that ranks, the share that qualifies it, and the latency of one frame."""
    protocol = record.protocol.id
    if protocol in HEADLINES:
        metric, group, qualifier, decimals = HEADLINES[protocol]
        error = estimate(record.metric(metric, group), decimals)
        share = estimate(record.metric(qualifier, "all"), 1)
        unit, percent = "" if error == "n/a" else " mm", "" if share == "n/a" else " %"
        yield f"{NAMES[metric]} {error}{unit}"
        yield f"{NAMES[qualifier]} {share}{percent}"
    times = [
        f"{number(row.p90_ms, 2)} ms on {_threads(row.threads)}"
        for row in rows
        if row.scenario == "single" and row.phase == "total"
    ]
    yield f"one frame to contacts, p90: {', '.join(times) or 'not timed'}"


def _threads(count: int) -> str:
    return f"{count} thread" if count == 1 else f"{count} threads"
