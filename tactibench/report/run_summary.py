"""A run in about ten lines: model and test, errors, misses, speed, its place.

``run_report`` prints the full report.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

from rich.console import Console
from rich.text import Text

from tactibench.board import (
    FEWEST_PRESSES,
    FEWEST_SEEDS,
    Placement,
    measured_on,
    settled_time,
    times_bound,
)
from tactibench.protocols.board_spec import board_spec
from tactibench.records import Record, SpeedRow
from tactibench.report.labels import named
from tactibench.report.numbers import number, plural, significant
from tactibench.report.run_rows import (
    NO_INTERVAL_NOTE,
    lacks_interval,
    measured_rows,
    print_warning,
    run_label,
)
from tactibench.report.table import Column, Table, metric_number, table
from tactibench.report.writers.terminal import print_table

MISSES = {
    "missed": ("missed", 1, " %"),
    "spurious": ("spurious", 3, " a frame"),
    "coverage": ("answered", 1, " %"),
    "catch_resolved": ("single seen as two", 1, " %"),
}
"""Metrics that stand beside every error -> name, decimals and unit."""
WHOLE = ("all", "mean")
"""Groups that stand for all test frames."""
MOST_METRICS = 4
"""Most metrics of a protocol that declares no table: more would not be a summary."""
GLOSSARY = "docs/glossary.md"
TERMS = {
    "mae_mm": "MAE",
    "rmse_mm": "RMSE",
    "distance_penalised_mm": "penalised error",
    "resolved": "resolved",
    "ospa_mm": "OSPA",
    "gospa1_mm": "GOSPA",
    "missed": "missed",
    "spurious": "spurious",
    "coverage": "coverage",
    "catch_resolved": "catch trial",
}
"""Metrics whose names the glossary explains -> the word in the glossary."""


def print_summary(
    console: Console, record: Record, folder: Path, place: Placement | None, board: Path
) -> None:
    """Print a run in about ten lines.

    Args:
        console: Console to print on.
        record: Record of the run.
        folder: Folder of the run, in its store.
        place: Place of the run on the board; None where it has none.
        board: Folder of the board.
    """
    headline = headline_table(record)
    console.print(Text(f"{_protocol(record)}  {record.protocol.title}", style="bold"))
    count = plural(record.data.test, "test frame")
    who = f"{run_label(record)}, {measured_on(record)}, seed {record.seed}: {count}"
    console.print(Text(who))
    print_warning(console, record)
    print_table(console, headline)
    if lacks_interval(headline):
        console.print(Text(NO_INTERVAL_NOTE, style="dim"), soft_wrap=True)
    for line in (misses_line(record), speed_line(record)):
        console.print(Text(line), soft_wrap=True)
    console.print(Text(record.signature, style="dim"), soft_wrap=True)
    console.print(_rest(record, folder), soft_wrap=True)
    console.print(Text(place_line(record, folder, place, board)), soft_wrap=True)


def headline_table(record: Record) -> Table:
    """Return the first main table that has groups, or else the metrics over all test frames."""
    spec = board_spec(record.protocol.label)
    run_table = next((columns for columns in spec.run_tables if columns.groups), None)
    if run_table is not None:
        names = ["", *(named(name, _unit(record, name)) for name in run_table.metrics)]
        rows = (row[: len(names)] for row in measured_rows(run_table, record)[0])
        return table(names, rows, title=f"{run_table.title}: value [95 % interval]")
    over_all = [m for m in record.metrics if m.group in WHOLE and m.metric not in MISSES]
    if spec.headline is not None:
        first = (spec.headline.metric, spec.headline.group)
        over_all.sort(key=lambda m: (m.metric, m.group) != first)
    decimals = 3 if spec.headline is None else spec.headline.decimals
    shown = [
        (named(m.metric, m.unit), metric_number(m, decimals), f"{m.clusters:,}")
        for m in over_all[:MOST_METRICS]
    ]
    return table(["", "value [95 % interval]", Column("presses")], shown)


def _unit(record: Record, name: str) -> str:
    return next((m.unit for m in record.metrics if m.metric == name), "")


def misses_line(record: Record) -> str:
    """Return what errors do not show: missed and spurious contacts, frames without an answer."""
    values = {name: metric_number(record.metric(name, "all"), MISSES[name][1]) for name in MISSES}
    parts = (
        f"{MISSES[name][0]} {value}{MISSES[name][2]}"
        for name, value in values.items()
        if value is not None
    )
    return f"misses: {', '.join(parts) or 'not measured'}"


def speed_line(record: Record) -> str:
    """Return the time of one frame and the best rate; a star marks one that is not settled."""
    totals = [row for row in record.speed if row.phase == "total"]
    single = sorted((r for r in totals if r.scenario == "single"), key=lambda row: row.threads)
    if not single:
        return "speed: not timed"
    fastest = max(totals, key=lambda row: row.per_s)
    times = [f"{number(r.p90_ms, 2)}{_star(r)} ms ({plural(r.threads, 'thread')})" for r in single]
    text = f"speed: frame to contacts, p90, {', '.join(times)}"
    text += f", at most {fastest.per_s:,.0f}{_star(fastest)} frames/s"
    return f"{text} (*: not settled, is the machine busy?)" if "*" in text else text


def _star(row: SpeedRow) -> str:
    return "" if settled_time(row) else "*"


def place_line(record: Record, folder: Path, place: Placement | None, board: Path) -> str:
    """Return rank, distance to the bound, and what to do next, in one line.

    Args:
        record: Record of the run.
        folder: Folder of the run, in its store.
        place: Place of the run on the board; None where it has none.
        board: Folder of the board.
    """
    parts = [*_place(record, place), f"next: {_next(record, folder.parent, place, board)}"]
    return f"place: {'; '.join(parts)}"


def _place(record: Record, place: Placement | None) -> Iterator[str]:
    if place is None:
        shortened = record.partial or record.limits.presses is not None
        why = "a shortened run is on no board" if shortened else "no board row to compare with"
        yield f"no rank, {why}"
    else:
        rank = f"rank {place.rank} of {place.rows} by {place.ranking.name}"
        if place.rank is None:
            rank = f"no rank yet, which takes {FEWEST_SEEDS} seeds and {FEWEST_PRESSES} presses"
        if place.above is None:
            yield f"{rank}, nothing above"
        else:
            pooled = place.above.metric(place.ranking.metric, place.ranking.group)
            value = "" if pooled is None else f" {number(pooled.value, place.ranking.decimals)}"
            yield f"{rank}, above it {place.above.label}{value}"
    if ratios := times_bound(record):
        low, high = map(significant, ratios)
        ends = low if low == high else f"{low} to {high}"
        yield f"RMSE {ends} times the bound"
    else:
        threshold, limit = (record.metric(name, "all") for name in ("threshold_mm", "limit_mm"))
        if limit is not None and limit.value is not None and threshold is not None:
            shown = metric_number(threshold, 2, interval=False)
            yield f"threshold {shown or 'n/a'} mm, limit {number(limit.value, 2)} mm"


def board_words(board: Path) -> list[str]:
    """Return the option that names a board in a command; [] for the default one."""
    return [] if board == Path("leaderboards") else ["--board", str(board)]


def _next(record: Record, store: Path, place: Placement | None, board: Path) -> str:
    if record.partial:
        return "the same command without --quick and --limit"
    on_board = board_words(board)
    if record.limits.presses is not None:
        words = ["plot", "curve", _protocol(record), "--store", str(store), *on_board]
    elif place is not None and place.committed:
        words = ["board", "show", _protocol(record), *on_board]
    else:
        in_store = [] if store == Path("runs") else ["--store", str(store)]
        words = ["board", "add", record.name, *in_store, *on_board]
    command = shlex.join(["tactibench", *words])
    if not board.is_dir():  # a verb refuses a board that is not there
        command = f"{shlex.join(['mkdir', str(board)])} && {command}"
    return f"it is on the board, see `{command}`" if words[1] == "show" else f"`{command}`"


def _protocol(record: Record) -> str:
    """Return the name under which the protocol version of the record can be run."""
    return record.protocol.id


def _rest(record: Record, folder: Path) -> Text:
    text = Text(f"more: --full; record and pictures: {folder}; words: ")
    return text.append(glossary_links(record))


def print_glossary(console: Console, record: Record) -> None:
    """Print where the terms of a run are explained."""
    console.print(Text("words: ").append(glossary_links(record)), soft_wrap=True)


def glossary_links(record: Record) -> Text:
    """Return the terms of a run, as links to the glossary on terminals that show links."""
    text = Text()
    page = Path(__file__).resolve().parents[2] / GLOSSARY  # a checkout has it, a wheel does not
    names = {m.metric for m in record.metrics}
    for word in (word for metric, word in TERMS.items() if metric in names):
        style = f"link {page.as_uri()}#{quote(anchor(word))}" if page.is_file() else ""
        text.append(word, style=style).append(", ")
    return text.append(GLOSSARY)


def anchor(word: str) -> str:
    """Return the anchor of a term on the page of the glossary."""
    return word.lower().replace(" ", "-")
