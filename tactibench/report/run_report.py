"""A run on the terminal: errors with intervals, misses, published rows, speed.

Every section says what it was measured on. All tables fit 80 columns; a wider terminal shows the
counts as columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from tactibench.board import NOT_STATED, measured_on, prior_of
from tactibench.metrics import condition
from tactibench.protocols import (
    UNTOUCHED,
    Axis,
    BoardSpec,
    PublishedRow,
    PublishedTable,
    RunTable,
    family_of,
    rows_for,
)
from tactibench.protocols.board_spec import board_spec
from tactibench.records import Metric, Record
from tactibench.report.labels import HEADS, NAMES, is_share, named
from tactibench.report.numbers import duration, fixed, number, span
from tactibench.report.run_rows import (
    NO_INTERVAL_NOTE,
    lacks_interval,
    measured_rows,
    metric_cell,
    partial_line,
    print_warning,
    run_label,
)
from tactibench.report.run_speed import print_speed
from tactibench.report.simulator_error import error_line
from tactibench.report.table import (
    PERCENT,
    Caption,
    Cell,
    Column,
    Head,
    Number,
    Table,
    metric_number,
    table,
)
from tactibench.report.writers.terminal import print_table

OTHERS = 6
"""Most stored runs that are shown: more would hide the run itself."""
COUNTS = (Column("n", optional=True), Column("presses", optional=True))
FALSE = "false_per_1000"
TOTALS = {FALSE: 1, "not_finite": 0, "raised": 0}
"""Metrics of hard cases that stand in sentences below the families, with their decimals."""
DECIMALS = {"share": 1, "deg": 2, "": 2}
"""Decimals of the list of further metrics, by unit; 3 for every other unit."""


def print_run(
    console: Console,
    record: Record,
    path: Path,
    published: Sequence[PublishedTable],
    others: Sequence[Record] = (),
    axes: Sequence[Axis] = (),
) -> None:
    """Print one run beside published rows and other stored runs.

    Args:
        console: Console to print on.
        record: Record of the run.
        path: File of the record.
        published: Tables of papers.
        others: Stored runs; the first six of the same version of the protocol are shown.
        axes: Axes of the families of hard cases that the run tests.
    """
    spec = board_spec(record.protocol.label)
    comparable = [other for other in others if same_question(other, record)]
    _print_heading(console, record)
    if axes:
        _print_hard_cases(console, record, axes)
    main = [
        _main_table(run_table, record, published, comparable[:OTHERS])
        for run_table in spec.run_tables
        if run_table.compared or measured_rows(run_table, record)[1]
    ]
    for shown in main:
        console.print()
        print_table(console, shown)
    if error := error_line(record):
        console.print(Text(error))
    if labels := labels_line(record):
        console.print(Text(labels))
    _print_notes(console, record, spec, published, len(comparable))
    further = [_further_metrics(record, spec, test) for test in ("", *spec.apart)]
    for shown in further:
        if shown.rows:
            console.print()
            print_table(console, shown)
    if any(map(lacks_interval, (*main, *further))):
        console.print(Text(NO_INTERVAL_NOTE, style="dim"))
    print_speed(console, record, spec, published)
    console.print()
    print_warning(console, record)
    console.print(Text(record.signature), soft_wrap=True)  # one line, to be copied whole
    console.print(Text(f"record: {path}"), soft_wrap=True)


def same_question(one: Record, other: Record) -> bool:
    """Return whether two different runs answer one version of a protocol and are tested alike.

    They may have been shown different numbers of labelled presses.
    """
    return (
        one.name != other.name
        and tested_sensor(one) == tested_sensor(other)
        and one.protocol.id == other.protocol.id
        and one.protocol.version == other.protocol.version
        and one.protocol.hash == other.protocol.hash
    )


def tested_sensor(record: Record) -> list[Any]:
    """Return all that tells a tested sensor from others; [] where it is the training sensor."""
    test = record.test_sensor
    return [] if test is None else [test.identity, test.description, test.trained_on]


def labels_line(record: Record) -> str:
    """Return how the true indentation follows from the labels; "" where nothing was fitted."""
    adapted = record.data.of_tested_sensor
    described = {} if adapted is None else adapted.described
    if "label_fit" not in described:
        return ""
    fit, columns = described["label_fit"], described.get("columns", {})
    depth, tilt = columns.get("depth", "depth label"), columns.get("tilt", "tilt label")
    return (
        f"true indentation: {depth} {described['depth_offset_mm']:+.3f} "
        f"{described['pivot_mm']:+.2f} (1 - cos {tilt}) "
        f"{described.get('pivot_side_mm', 0.0):+.2f} sin {tilt} mm, fitted to the pins of "
        f"{fit['presses']:,} presses ({fit['left_out']:,} left out, misfit {fit['misfit']:.1%})"
    )


def _print_heading(console: Console, record: Record) -> None:
    data, tested = record.data, record.test_sensor
    encoder = f"encoder {record.encoder.name}" if record.encoder else "no encoder"
    console.print(Text(f"{record.protocol.id}  {record.protocol.title}", style="bold"))
    console.print(
        Text(f"{run_label(record)}, {encoder}, {measured_on(record)}, seed {record.seed}")
    )
    why = "rejected by geometry" if record.sensor.recording is None else "of other ranges or tips"
    rejected = f"; {data.rejected:,} {why}" if data.rejected else ""
    if record.sensor.range is not None:
        console.print(Text(f"pressed in its {record.sensor.range.text()}"))
    frames = ""
    if tested is not None and tested.presses != data.test:
        frames = f"frames of {tested.presses:,} "
    console.print(
        Text(
            f"{data.train:,} training, {data.validation:,} validation, "
            f"{data.test:,} test {frames}presses{rejected}"
        )
    )
    training = record.training
    if training.epochs:
        when = "weights reused, trained" if training.reused else "trained"
        console.print(
            Text(
                f"{when} {training.epochs} epochs on {training.presses:,} "
                f"presses in {duration(training.seconds or 0.0)}"
            )
        )
    if mixed := training.notes.get("mixed"):
        console.print(Text(f"and on {mixed:,} frames mixed out of single presses"))
    if (prior := prior_of(record)) not in ("none", NOT_STATED):
        console.print(Text(f"prior knowledge of contacts that press together: {prior}"))
    print_warning(console, record)


def _main_table(
    run_table: RunTable,
    record: Record,
    published: Sequence[PublishedTable],
    others: Sequence[Record],
) -> Table:
    """Return a table of this run, other runs and published rows, each below a caption."""
    rows: list[list[Cell]] = []
    captions: dict[int, tuple[Caption, ...]] = {}

    def add(caption: tuple[Caption, ...], more: list[list[Cell]]) -> None:
        if more:
            captions[len(rows)] = caption
            rows.extend(more)

    add(*_measured(run_table, record))
    for other in others if run_table.compared else ():
        add(*_measured(run_table, other, stored=True))
    for paper in published if run_table.compared else ():
        head = f"published: {paper.measured_on} ({paper.name} {paper.year})"
        for k, row in enumerate(rows_for(record.protocol.id, paper)):
            label = Caption(_published_label(row), "italic")
            origin = (label,) if k else (Caption(head, "magenta"), label)
            add(origin, _printed_rows(run_table, row))
    names = ["", *(HEADS[metric] for metric in run_table.metrics)]
    columns = [Column(name, right=False) for name in names]
    title = f"{run_table.title}: value [95 % interval]"
    return Table((*columns, *COUNTS), tuple(map(tuple, rows)), title, captions=captions)


def _measured(
    run_table: RunTable, record: Record, *, stored: bool = False
) -> tuple[tuple[Caption, ...], list[list[Cell]]]:
    rows, shown = measured_rows(run_table, record)
    head = f"measured here: {run_label(record)}, {measured_on(record)}"
    if stored:
        warning = partial_line(record)
        head += f"\n  stored as {record.name}" + (f"; {warning}" if warning else "")
    n, presses = (span(counts) for counts in ([m.n for m in shown], [m.clusters for m in shown]))
    return (Caption(head, "cyan"), Caption("", "italic", f"n {n}, presses {presses}")), rows


def _published_label(row: PublishedRow) -> str:
    count = f", n {row.n:,} {row.unit}" if row.n else ""
    return f"{row.label}: {row.source.split(',')[0]}{count}"


def _printed_rows(run_table: RunTable, row: PublishedRow) -> list[list[Cell]]:
    """Return the values of a paper, with no more digits than the paper or the column has."""
    rows: list[list[Cell]] = []
    for group in run_table.groups:
        cells: list[Cell] = []
        for name, decimals in run_table.metrics.items():
            value, share = row.value(name, group), is_share(name)
            printed = max(row.decimals - 2, 0) if share else row.decimals
            write = fixed(min(printed, decimals))
            scale = PERCENT if share else 1.0
            cells.append(None if value is None else Number(scale * value, write))
        if any(cells):
            rows.append([group, *cells, f"{row.n:,}" if row.n else "n/a", ""])
    return rows


def _print_notes(
    console: Console,
    record: Record,
    spec: BoardSpec,
    published: Sequence[PublishedTable],
    comparable: int,
) -> None:
    notes = [spec.note] if spec.note else []
    if comparable > OTHERS and spec.run_tables:
        hidden = comparable - OTHERS
        notes.insert(0, f"{hidden} more stored runs of {record.protocol.id} are not shown")
    for note in (*notes, *_comparability(record, published)):
        console.print(Text(note, style="dim"))


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


def _further_metrics(record: Record, spec: BoardSpec, test: str) -> Table:
    """Return a table of every metric that no main table shows, with its counts.

    Args:
        record: Record of the run.
        spec: Tables of the protocol.
        test: Name of a test scored apart, which is left out of its groups; "": the main test.
    """
    groups = {m.group: m.group for m in record.metrics if family_of(m.group) not in spec.apart}
    if test:
        of_test = {m.group for m in record.metrics if family_of(m.group) == test}
        groups = {name: name.removeprefix(test).removeprefix(":") or "all" for name in of_test}
    metrics = [
        metric
        for metric in record.metrics
        if metric.group in groups and _is_further(metric, record, spec.run_tables)
    ]
    grouped = any(groups[metric.group] != "all" for metric in metrics)
    rows: list[list[Cell]] = []
    last = ""
    for metric in metrics:
        name = "" if metric.metric == last else named(metric.metric, metric.unit)
        value = metric_cell(metric, DECIMALS.get(metric.unit, 3))
        group = (groups[metric.group],) if grouped else ()
        rows.append([name, *group, value, f"{metric.n:,}", f"{metric.clusters:,}"])
        last = metric.metric
    group_head = ("of",) if grouped else ()
    counts = (Column("n"), Column("presses"))
    title = f"Also measured, {test}" if test else "Also measured"
    heads: list[Head] = [title, *group_head, "value [95 % interval]", *counts]
    return table(heads, rows)


def _is_further(metric: Metric, record: Record, tables: Sequence[RunTable]) -> bool:
    """Return whether no main table shows a metric; of hard cases only totals count."""
    if any(metric.metric in t.metrics and metric.group in t.groups for t in tables):
        return False
    by_distance = any(metric.metric in t.metrics and not t.groups for t in tables)
    if by_distance and condition(metric.group) is not None:
        return False
    hard = any(other.metric == "error_ratio" for other in record.metrics)
    return not hard or (metric.group == "all" and metric.metric not in TOTALS)


def _print_hard_cases(console: Console, record: Record, axes: Sequence[Axis]) -> None:
    from tactibench.board import Row
    from tactibench.report.hard_cases import family_table

    console.print()
    print_table(console, family_table(Row((record,)), axes))
    console.print()
    for line in _totals(record):
        console.print(Text(line))


def _under_faults(record: Record) -> str:
    """Return the false contacts in empty frames under faults; "" where none was tested."""
    all_faults = record.metric(FALSE, UNTOUCHED)
    if all_faults is None:
        return ""
    shares = (
        f"{m.group.partition(':')[2]} {number(m.value, 1)}"
        for m in record.metrics
        if m.metric == FALSE and m.group.startswith(f"{UNTOUCHED}:") and m.value is not None
    )
    return (
        f"  each under a fault: {metric_number(all_faults, 1, interval=True)} ({', '.join(shares)})"
    )


def _totals(record: Record) -> Iterator[str]:
    totals = {m.metric: m for m in record.metrics if m.group == "all"}
    for name, decimals in TOTALS.items():
        total = metric_number(totals.get(name), decimals, interval=decimals > 0)
        if total is not None:
            yield f"{NAMES[name]}: {total}"
        if name == FALSE and (line := _under_faults(record)):
            yield line
    failures = record.data.failures
    for cause in () if failures is None else failures.causes:
        yield f"  {cause.frames:,} x {cause.cause} (first: {cause.first})"
