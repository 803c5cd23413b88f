"""A run on the terminal: in about ten lines, or whole with all tables, published rows and times."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from tactibench.metrics import FORCE, condition
from tactibench.protocols import (
    Axis,
    BoardSpec,
    PublishedTable,
    RunTable,
    board_spec,
    load_protocol,
    rows_for,
)
from tactibench.records import Metric, Record, SensorId, SpeedRow, StoredRun, measured_on
from tactibench.report.tables import (
    HEADS,
    NAMES,
    NO_INTERVAL,
    Cell,
    Column,
    Head,
    Number,
    Table,
    duration,
    error_words,
    fixed,
    general,
    metric_number,
    named,
    number,
    plural,
    print_table,
    published_number,
    span,
    table,
)
from tactibench.run import settled_time
from tactibench.shipped import OWN_BOARD, default_board

if TYPE_CHECKING:
    from tactibench.board import Placement, Section

MISSES = {
    "missed": ("missed", 1, " %"),
    "spurious": ("spurious", 3, " a frame"),
    "coverage": ("answered", 1, " %"),
    "catch_resolved": ("single seen as two", 1, " %"),
}
"""Metrics that stand beside every error -> name, decimals and unit."""
WHOLE = ("all", "mean")
"""Groups that stand for all test frames."""
MOST_METRICS = 6
"""Most metrics of a run in ten lines."""
GLOSSARY = "docs/glossary.md"
NO_INTERVAL_NOTE = f"{NO_INTERVAL}: no interval; the presses are too few, or the value cannot vary."
FALSE = "false_per_1000"
TOTALS = {FALSE: 1, "not_finite": 0, "raised": 0}
"""Metrics of hard cases that stand in sentences below the families, with their decimals."""
DECIMALS = {"share": 1, "deg": 2, "": 2}
"""Decimals of the list of further metrics, by unit; 3 for every other unit."""


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
    _print_title(console, record)
    _print_warning(console, record)
    print_table(console, headline)
    if lacks_interval(headline):
        console.print(Text(NO_INTERVAL_NOTE, style="dim"), soft_wrap=True)
    for line in (*truth_lines(record), misses_line(record), speed_line(record)):
        console.print(Text(line), soft_wrap=True)
    console.print(Text(record.signature, style="dim"), soft_wrap=True)
    stored = "record and pictures" if any(folder.glob("*.png")) else "record"
    words = f"; words: {GLOSSARY}" if Path(GLOSSARY).is_file() else ""  # not beside a wheel
    text = f"more: --full; {stored}: {folder}{words}"
    console.print(Text(text), soft_wrap=True)
    console.print(Text(place_line(record, folder, place, board)), soft_wrap=True)


def headline_table(record: Record) -> Table:
    """Return the error that ranks the board, those of tests apart, and errors over all frames."""
    from tactibench.board import unseen_error

    spec = board_spec(record.protocol.label)
    ranked = [] if spec.ranking is None else [spec.ranking, *spec.apart.values()]
    unseen = unseen_error(load_protocol(record.protocol.id)) if ranked else None
    rows: list[list[Cell]] = []
    for error in ranked:
        metric = record.metric(error.metric, error.group)
        if metric is not None:
            name, value = error_words(error, metric)
            name += " (ranks the board)" if error is spec.ranking else ""
            unit = " sensors" if error == unseen else ""
            rows.append([name, value, f"{metric.clusters:,}{unit}"])
    said = {(error.metric, error.group) for error in ranked}
    further = {name: d for columns in spec.run_tables for name, d in columns.metrics.items()}
    for m in record.metrics:
        asked = m.metric not in MISSES and (not further or m.metric in further)
        if m.group in WHOLE and asked and (m.metric, m.group) not in said:
            value = metric_cell(m, further.get(m.metric, 3))
            rows.append([named(m.metric, m.unit), value, f"{m.clusters:,}"])
    rows = [row for row in rows if row[1] is not None][:MOST_METRICS]
    return table(["", "value [95 % interval]", Column("presses")], rows)


def truth_lines(record: Record) -> Iterator[str]:
    """Yield what the truth does not know, and the error of the force where it knows it."""
    x, depth = (record.metric("mae_mm", axis) for axis in ("x", "z"))
    if x is not None and x.value is not None and depth is not None and depth.value is None:
        yield "depth: not known, so that errors of z are n/a and means are of x and y"
    if value := metric_number(record.metric(FORCE, "all"), 3):
        yield f"{named(FORCE, 'N')}: {value}"


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
    star = {id(row): "" if settled_time(row) else "*" for row in totals}
    times = [
        f"{number(row.p90_ms, 2)}{star[id(row)]} ms ({plural(row.threads, 'thread')})"
        for row in single
    ]
    text = f"speed: frame to contacts, p90, {', '.join(times)}"
    text += f", at most {fastest.per_s:,.0f}{star[id(fastest)]} frames/s"
    return f"{text} (*: not settled, is the machine busy?)" if "*" in text else text


def place_line(record: Record, folder: Path, place: Placement | None, board: Path) -> str:
    """Return the rank, and what to do next, in one line.

    Args:
        record: Record of the run.
        folder: Folder of the run, in its store.
        place: Place of the run on the board; None where it has none.
        board: Folder of the board.
    """
    parts = [*_place(record, place, board), f"next: {_next(record, folder.parent, board)}"]
    return f"place: {'; '.join(parts)}"


def _place(record: Record, place: Placement | None, board: Path) -> Iterator[str]:
    if place is None:
        from tactibench.board import read_submissions, section_key, sections_of

        shortened = record.partial or record.limits.presses is not None
        rows = () if shortened else read_submissions(board, record.protocol.id)
        others = sections_of(row for row in rows if section_key(row) != section_key(record))
        titles = dict.fromkeys(_tested_on(section, record.sensor) for section in others)
        why = "a shortened run is on no board" if shortened else "no row was tested on these frames"
        yield f"no rank, {why}"
        if titles:
            yield f"its rows are of other test frames: {' and '.join(list(titles)[:2])}"
    else:
        from tactibench.board import FEWEST_PRESSES, FEWEST_SEEDS

        rank = f"rank {place.rank} of {place.rows} by {place.ranking.name}"
        if place.rank is None:
            rank = (
                f"no rank yet, which takes {FEWEST_SEEDS} seeds in one command (--seeds 0,1,2) "
                f"and {FEWEST_PRESSES} presses"
            )
        if place.above is None:
            yield f"{rank}, nothing above"
        else:
            pooled = place.above.metric(place.ranking.metric, place.ranking.group)
            value = "" if pooled is None else f" {number(pooled.value, place.ranking.decimals)}"
            yield f"{rank}, above it {place.above.label}{value}"
        if place.trivial is not None:
            yield f"its error is larger than that of the trivial {place.trivial.label}"


def _tested_on(section: Section, mine: SensorId) -> str:
    """Return the title of a section, with up to three defaults of its sensor that mine has not.

    Defaults of one sensor differ between versions of tactibench.
    """
    theirs = section.sensor
    old = [
        f"{name}={value}"
        for name, value in theirs.parameters.items()
        if name not in theirs.settings and mine.parameters.get(name) != value
    ]
    words = f" with {', '.join(old[:3])}" if old and theirs.name == mine.name else ""
    return f"{section.title}{words}"


def print_ranked(console: Console, runs: Sequence[StoredRun]) -> None:
    """Print runs of one protocol as rows of a table, seeds pooled, with the ranks among them."""
    from tactibench.board import ordered, press_errors_of, ranks, rows_of
    from tactibench.report.board_tables import shown_errors, summary_table

    protocol = load_protocol(runs[0].record.protocol.id)
    name = protocol.spec.id
    columns, rows = shown_errors(protocol), ordered(name, rows_of(run.record for run in runs))
    if not columns or len(rows) < 2:
        return
    errors = {
        run.record.name: press_errors_of(
            protocol.spec, run.arrays("truth"), run.arrays("predictions")
        )
        for run in runs
    }
    ranked = ranks(name, rows, errors)
    found = None if ranked is None else summary_table(rows, ranked, columns, "")
    if found is not None:
        console.print()
        print_table(console, found)


def board_words(board: Path) -> list[str]:
    """Return the option that names a board in a command; [] for the default one."""
    return [] if board in (OWN_BOARD, default_board()) else ["--board", str(board)]


def _next(record: Record, store: Path, board: Path) -> str:
    if record.partial:
        return "the same command without --quick and --limit"
    on_board, name = board_words(board), record.protocol.id
    if record.limits.presses is not None:
        words = ["plot", "curve", name, "--store", str(store), *on_board]
    elif (board / "submissions" / name / f"{record.name}.json").is_file():
        words = ["board", "show", name, *on_board]
    else:
        in_store = [] if store == Path("runs") else ["--store", str(store)]
        words = ["board", "add", record.name, *in_store, *on_board]
        if not on_board and not OWN_BOARD.is_dir():  # rows are not added to what is installed
            board = Path("my-board")  # a folder leaderboards would hide the rows that ship
            words += ["--board", str(board)]
    command = shlex.join(["tactibench", *words])
    if words[1] == "add" and not board.is_dir():  # it refuses a board that is not there
        command = f"{shlex.join(['mkdir', str(board)])} && {command}"
    return f"it is on the board, see `{command}`" if words[1] == "show" else f"`{command}`"


def print_run(
    console: Console,
    record: Record,
    path: Path,
    published: Sequence[PublishedTable],
    axes: Sequence[Axis] = (),
) -> None:
    """Print one run beside published rows.

    Args:
        console: Console to print on.
        record: Record of the run.
        path: File of the record.
        published: Tables of papers.
        axes: Axes of the families of hard cases that the run tests.
    """
    spec = board_spec(record.protocol.label)
    _print_heading(console, record)
    if axes:
        from tactibench.board import Row
        from tactibench.report.board_tables import family_table

        console.print()
        print_table(console, family_table(Row((record,)), axes))
        console.print()
        for line in _totals(record):
            console.print(Text(line))
    main = []
    for run_table in spec.run_tables:
        measured = measured_table(run_table, record)
        tables = [measured, *_published_tables(run_table, record, published)]
        for k, one in enumerate(filter(_has_value, tables)):
            if not k:
                console.print()
            print_table(console, one)
        main.append(measured)
    if line := error_line(record):
        console.print(Text(line))
    for line in truth_lines(record):
        console.print(Text(line))
    for note in filter(None, (spec.note, *_comparability(record, published))):
        console.print(Text(note, style="dim"))
    further = _further_metrics(record, spec)
    if further.rows:
        console.print()
        print_table(console, further)
    if any(map(lacks_interval, (*main, further))):
        console.print(Text(NO_INTERVAL_NOTE, style="dim"))
    _print_speed(console, record, published)
    console.print()
    _print_warning(console, record)
    console.print(Text(record.signature), soft_wrap=True)  # one line, to be copied whole
    console.print(Text(f"record: {path}"), soft_wrap=True)


def _print_title(console: Console, record: Record) -> None:
    from tactibench.board import label_of

    console.print(Text(f"{record.protocol.id}  {record.protocol.title}", style="bold"))
    console.print(Text(f"{label_of(record)}, {measured_on(record)}, seed {record.seed}"))


def _print_heading(console: Console, record: Record) -> None:
    data, tested, training = record.data, record.test_sensor, record.training
    encoder = f"encoder {record.encoder.name}" if record.encoder else "no encoder"
    _print_title(console, record)
    lines = [encoder]
    if record.sensor.range is not None:
        lines.append(f"pressed in its {record.sensor.range.text()}")
    frames = ""
    if tested is not None and tested.presses != data.test:
        frames = f"frames of {tested.presses:,} "
    why = "rejected by geometry" if record.sensor.recording is None else "of other ranges or tips"
    rejected = f"; {data.rejected:,} {why}" if data.rejected else ""
    lines.append(
        f"{data.train:,} training, {data.validation:,} validation, "
        f"{data.test:,} test {frames}presses{rejected}"
    )
    if training.epochs:
        when = "weights reused, trained" if training.reused else "trained"
        time = duration(training.seconds or 0.0)
        lines.append(f"{when} {training.epochs} epochs on {training.presses:,} presses in {time}")
    if mixed := training.notes.get("mixed"):
        lines.append(f"and on {mixed:,} frames mixed out of single presses")
    if (prior := training.prior) not in ("none", None):
        lines.append(f"prior knowledge of contacts that press together: {prior}")
    for line in lines:
        console.print(Text(line))
    _print_warning(console, record)


def _has_value(shown: Table) -> bool:
    return any(isinstance(cell, Number) for row in shown.rows for cell in row)


def _published_tables(
    run_table: RunTable, record: Record, published: Sequence[PublishedTable]
) -> Iterator[Table]:
    """Yield the values of every published row, in the columns of a table of this run."""
    units = {metric.metric: metric.unit for metric in record.metrics}
    names = ["", *(HEADS.get(m, named(m, units.get(m, ""))) for m in run_table.metrics)]
    for paper in published if run_table.compared else ():
        for row in rows_for(record.protocol.id, paper):
            count = f", n {row.n:,} {row.unit}" if row.n else ""
            title = (
                f"published: {row.label}, {row.source.split(',')[0]}{count}; {paper.measured_on} "
                f"({paper.name} {paper.year})"
            )
            rows: list[list[Cell]] = [
                [group, *(published_number(row, m, group, d) for m, d in run_table.metrics.items())]
                for group in run_table.groups
                if any(row.value(m, group) is not None for m in run_table.metrics)
            ]
            yield table(names, rows, title=title)


def _comparability(record: Record, published: Sequence[PublishedTable]) -> Iterable[str]:
    """Return why published rows can or cannot be compared with this run, each reason once."""
    words = {"yes": "Comparable", "partly": "Partly comparable", "no": "Not comparable"}
    simulated = record.sensor.origin == "simulated"
    reasons = []
    for row in (row for paper in published for row in rows_for(record.protocol.id, paper)):
        if simulated:
            reasons.append(f"Not comparable (simulated here): {row.note}")
        elif row.comparable == "yes" and not record.data.published_frames:
            reasons.append("Not comparable: this run was not tested on the published test frames.")
        else:
            reasons.append(f"{words[row.comparable]}: {row.note}")
    return dict.fromkeys(reasons)


def _further_metrics(record: Record, spec: BoardSpec) -> Table:
    """Return a table of every metric that no main table shows, with its counts."""
    rows: list[list[Cell]] = [
        [
            named(metric.metric, metric.unit),
            metric.group,
            metric_cell(metric, DECIMALS.get(metric.unit, 3)),
            f"{metric.n:,}",
            f"{metric.clusters:,}",
        ]
        for metric in record.metrics
        if metric.value is not None and _is_further(metric, record, spec.run_tables)
    ]
    counts = (Column("n"), Column("presses"))
    return table(["Also measured", "of", "value [95 % interval]", *counts], rows)


def _is_further(metric: Metric, record: Record, tables: Sequence[RunTable]) -> bool:
    """Return whether no main table shows a metric; of hard cases only totals count."""
    if any(metric.metric in t.metrics and metric.group in t.groups for t in tables):
        return False
    by_distance = any(metric.metric in t.metrics and not t.groups for t in tables)
    if by_distance and condition(metric.group) is not None:
        return False
    hard = any(other.metric == "error_ratio" for other in record.metrics)
    return not hard or (metric.group == "all" and metric.metric not in TOTALS)


def _totals(record: Record) -> Iterator[str]:
    totals = {m.metric: m for m in record.metrics if m.group == "all"}
    for name, decimals in TOTALS.items():
        total = metric_number(totals.get(name), decimals, interval=decimals > 0)
        if total is not None:
            yield f"{NAMES[name]}: {total}"
    failures = record.data.failures
    for cause in () if failures is None else failures.causes:
        yield f"  {cause.frames:,} x {cause.cause} (first: {cause.first})"


def partial_line(record: Record) -> str:
    """Return the warning of a run that was cut short; "" for a complete run."""
    if not record.partial:
        return ""
    causes = ["quick"] if record.limits.quick else []
    if record.limits.limit is not None:
        causes.append(f"limit {record.limits.limit}")
    cause = f" ({', '.join(causes)})" if causes else ""
    weak = "its errors say nothing of the model, " if record.limits.quick else ""
    return f"PARTIAL{cause}: {weak}not for a board"


def _print_warning(console: Console, record: Record) -> None:
    if line := partial_line(record):
        console.print(Text(line, style="bold red"))
    if why := record.training.notes.get("not_refined"):
        console.print(Text(f"not refined: {why}", style="bold red"))


def lacks_interval(shown: Table) -> bool:
    """Return whether a table holds a value from which no interval could be made."""
    cells = (cell for row in shown.rows for cell in row)
    return any(isinstance(cell, Number) and str(cell).endswith(NO_INTERVAL) for cell in cells)


def measured_table(run_table: RunTable, record: Record) -> Table:
    """Return a main table: a row a group, with the counts behind its values in the title."""
    metrics = {(metric.metric, metric.group): metric for metric in record.metrics}
    distances = {
        group: distance
        for name, group in metrics
        if name in run_table.metrics and (distance := condition(group)) is not None
    }
    present = {group for name, group in metrics if name in run_table.metrics}
    groups = [group for group in run_table.groups if group in present] or (
        run_table.groups or sorted(distances, key=distances.__getitem__)
    )
    columns = {name: [metrics.get((name, group)) for group in groups] for name in run_table.metrics}
    rows: list[list[Cell]] = [
        [group, *(metric_cell(columns[name][k], d) for name, d in run_table.metrics.items())]
        for k, group in enumerate(groups)
    ]
    rows = [row for row in rows if any(cell is not None for cell in row[1:])]
    shown = [metric for column in columns.values() for metric in column if metric is not None]
    units = {metric.metric: metric.unit for metric in shown}
    # Four columns by distance fit a terminal under their short heads alone.
    short = {} if run_table.groups else HEADS
    names = ["", *(short.get(name, named(name, units.get(name, ""))) for name in columns)]
    presses = span([metric.clusters for metric in shown if metric.n])
    title = f"{run_table.title}: value [95 % interval], {presses} presses"
    return table(names, rows, title=title)


def metric_cell(metric: Metric | None, decimals: int) -> Number | None:
    """Return the number of a metric with its interval; a bound is a tested distance: "< 6.5"."""
    value = metric_number(metric, decimals)
    return replace(value, write=general) if value is not None and value.bound else value


def _print_speed(console: Console, record: Record, published: Sequence[PublishedTable]) -> None:
    """Print the time of one frame, every timed phase, and the cost of the model."""
    facts = record.environment
    console.print()
    console.print(Text(speed_line(record)), soft_wrap=True)
    machine = f"{facts.cpu}, {plural(facts.threads, 'thread')}, fingerprint {facts.fingerprint}"
    console.print(Text(machine, style="dim"))
    if record.speed:
        print_table(console, speed_table([("", row) for row in record.speed]))
    if record.efficiency:
        console.print(Text(_cost(record)))
    for row in (row for paper in published for row in rows_for(record.protocol.id, paper)):
        if row.speed:
            text = (
                f"published: {row.label}, {row.speed.phase} {row.speed.per_s:g} per s on "
                f"{row.speed.hardware}, another machine"
            )
            console.print(Text(text, style="magenta"))


def speed_table(rows: Sequence[tuple[str, SpeedRow]]) -> Table:
    """Return the times of every phase for single frames, and of the whole call for batches.

    Args:
        rows: Name of the model and its times; "" for the model of a run.
    """
    cells: list[list[Cell]] = []
    for name, row in rows:
        if row.scenario == "offline" and row.phase != "total":
            continue
        mark = "" if settled_time(row) else "*"
        times = (Number(value, fixed(2)) for value in (row.p50_ms, row.p90_ms, row.p99_ms))
        rate = f"{row.per_s:,.0f}{mark}" if row.phase == "total" else ""
        call = (row.scenario, str(row.batch), str(row.threads), row.phase)
        cells.append([*filter(None, [name]), *call, *times, rate])
    heads: list[Head] = ["model"] if any(name for name, _ in rows) else []
    heads += ["scenario", "batch", "threads", "phase"]
    heads += map(Column, ("p50 ms", "p90 ms", "p99 ms", "frames/s"))
    note = "*: not settled: the times still drifted, or something else computed meanwhile."
    unsettled = any(not settled_time(row) for _, row in rows)
    return table(heads, cells, notes=[note] if unsettled else [])


def _cost(record: Record) -> str:
    cost = record.efficiency
    facts = {
        "weights {:,}": cost.parameters,
        "{:.3g} GFLOP a frame": cost.flops_per_frame and 1e-9 * cost.flops_per_frame,
        "peak memory of the process {:,.0f} MB": cost.peak_memory_mb,
        "training {:,.0f} s": cost.training_s,
    }
    known = [text.format(value) for text, value in facts.items() if value is not None]
    return f"cost: {', '.join(known) or 'not measured'}"


def error_line(record: Record) -> str:
    """Return how far the simulator is from finite elements; "" where the record states nothing."""
    errors = record.data.simulator
    known = [error for error in errors if error.median_mm is not None and error.max_mm is not None]
    title = "error bound of the simulator at a pin"
    if not known:
        return f"{title}: not known" if errors else ""
    medians = sorted({f"{error.median_mm:.3f}" for error in known})
    ends = " to ".join(dict.fromkeys((medians[0], medians[-1])))
    largest = max(error.max_mm or 0.0 for error in known)
    unknown, scenes = (sum(getattr(e, name) for e in errors) for name in ("unknown", "scenes"))
    text = f"{title}, against finite elements: median {ends} mm, at most {largest:.3f} mm"
    return text + (f" (not known for {unknown:,} of {scenes:,} scenes)" if unknown else "")
