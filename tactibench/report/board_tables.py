"""Tables of a board: one row for each model in one configuration, its training seeds pooled."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from tactibench.board import (
    Case,
    Curve,
    FamilyErrors,
    OverviewLine,
    PooledMetric,
    Ranks,
    Row,
    by_machine,
    counts,
    family_errors,
    fitted_frames,
    frames_per_second,
    label_of,
    latency,
    machine,
    prior_of,
    row_anchor,
    settled,
)
from tactibench.protocols import (
    Axis,
    BoardSpec,
    PublishedRow,
    PublishedTable,
    Ranking,
    load_protocol,
    overview_spec,
    rows_for,
)
from tactibench.protocols import Block as BoardTable
from tactibench.protocols import Column as MetricColumn
from tactibench.records import Record
from tactibench.report.tables import (
    HEADS,
    Cell,
    Column,
    Format,
    Head,
    Number,
    Table,
    Text,
    duration,
    fixed,
    general,
    is_share,
    metric_number,
    named,
    number,
    plural,
    published_number,
    scaled,
    significant,
    span,
    table,
)

BELOW = "†"
"""Marks a model whose errors are below the Cramer-Rao bound."""
WITH_INTERVALS = 2
"""Most models whose intervals fit beside each other."""
PUBLISHED_HEADS = HEADS | {"coverage": "answered, %", "distance_mae_mm": "distance error, mm"}
DOUBLING_NOTE = (
    "Value at which the error is twice that of the easy case, linear between the cases; below "
    'it, where the ends of the ratios\' 95 % intervals reach two. "<", ">": not doubled at '
    "the hardest case, which stands behind it. n/a: the easy case costs more than half the "
    "gate already. A model with a small error doubles it early."
)


def board_table(
    rows: Sequence[Row],
    heads: Sequence[str],
    body: Sequence[Sequence[Cell]],
    *,
    title: str,
    notes: Iterable[str] = (),
    ranks: Ranks | None = None,
) -> Table | None:
    """Return a table of rows of a board, without columns and rows that hold no value.

    Args:
        rows: Rows, in the order of the table.
        heads: Names of the columns behind the name of the row.
        body: Cells of every row.
        title: Heading of the table.
        notes: Sentences below the table.
        ranks: Ranks of the rows, for a column before the others; the names of the rows then say
            prior knowledge and seeds, and a page can be linked to them. None: no such column.

    Returns:
        None where nothing is left.
    """
    shown = [k for k, cells in enumerate(body) if any(cell is not None for cell in cells)]
    used = [c for c in range(len(heads)) if any(body[k][c] is not None for k in shown)]
    if not used:
        return None
    cells: list[list[Cell]] = []
    for k in shown:
        rank = None if ranks is None else ranks.by_row[k]
        first = [] if ranks is None else [None if rank is None else Number(rank, fixed(0))]
        name = row_name(rows[k], details=ranks is not None)
        cells.append([*first, name, *(body[k][c] for c in used)])
    left_out = len(rows) - len(shown)
    gaps = f"{plural(left_out, 'row')} without a value not shown." if left_out else ""
    first_heads = ["model"] if ranks is None else [Column("rank"), "model"]
    columns = [*first_heads, *(Column(heads[c]) for c in used)]
    anchors = () if ranks is None else [row_anchor(rows[k]) for k in shown]
    return table(columns, cells, title=title, notes=(*notes, gaps), anchors=anchors)


def row_name(row: Row, *, details: bool = False) -> Text:
    """Return the label of a row, in italics for a trivial model.

    Args:
        row: The row.
        details: Whether prior knowledge and the number of seeds stand below.
    """
    known = prior_of(row.first)  # how many frames were mixed stands in the label
    prior = "" if known == "none" else f"prior knowledge: {known}, "
    label = f"{row.label} {BELOW}" if row.below_bound else row.label
    seeds = plural(len(row.records), "seed")
    below = f"{prior}{seeds}, {row.reproduced}" if details else ""
    return Text(label, "italic" if row.trivial else "", below)


def metric_blocks(spec: BoardSpec, rows: Iterable[Row]) -> tuple[BoardTable, ...]:
    """Return the tables that a board declares; one of all metrics where it declares none."""
    if spec.blocks:
        return spec.blocks
    groups: dict[tuple[str, str], set[str]] = {}
    for metric in (metric for row in rows for record in row.records for metric in record.metrics):
        groups.setdefault((metric.metric, metric.unit), set()).add(metric.group)
    columns = tuple(
        MetricColumn(
            metric=name,
            # Errors by axis have no group of all test frames, but a mean.
            group="mean" if present & {"all", "mean"} == {"mean"} else "all",
            head=named(name, unit),
            decimals=4,
        )
        for (name, unit), present in groups.items()
    )
    return (BoardTable(title="Metrics", columns=columns),)


def metric_table(spec: BoardTable, rows: Sequence[Row], ranks: Ranks | None = None) -> Table | None:
    """Return the table of a board; None where no row has its first column.

    Args:
        spec: Metrics of the table.
        rows: Rows, in the order of the table.
        ranks: Ranks of the rows; None: they are not ranked here.
    """
    first = spec.columns[0]
    if spec.sorted:
        rows = sorted(rows, key=lambda row: _first_value(row, first))
    pooled = [row.metric(first.metric, first.group) for row in rows]
    if spec.optional and not any(pooled):
        return None
    fitted = [fitted_frames(row.first) for row in rows]
    heads = [column.head for column in spec.columns]
    body: list[list[Cell]] = [[_metric_cell(row, c, spec) for c in spec.columns] for row in rows]
    if any(fitted):
        heads.insert(0, "labelled frames besides")
        for cells, frames in zip(body, fitted, strict=True):
            cells.insert(0, Number(0 if frames is None else frames.known, fixed(0)))
    presses = [count for value in pooled if value is not None for count in value.clusters]
    counted = f"{span(presses)} presses." if presses else ""
    ranking = () if ranks is None else (ranks.note, _unsure(ranks, rows))
    notes = (spec.note, counted, *ranking)
    return board_table(rows, heads, body, title=spec.title, notes=notes, ranks=ranks)


def own_test_table(rows: Sequence[Row], own: Sequence[Row | None], error: Ranking) -> Table | None:
    """Return the error of rows beside that of the same weights on the protocol's own test.

    Args:
        rows: Rows that were tested on something else.
        own: Rows of the same weights on the protocol's own test; None where there are none.
        error: Error that ranks the board.

    Returns:
        None where no row was tested on the protocol's own test.
    """

    def written(row: Row | None) -> Cell:
        pooled = None if row is None else row.metric(error.metric, error.group)
        return metric_number(pooled, error.decimals)

    if not any(own):
        return None
    body = [[written(here), written(there)] for here, there in zip(rows, own, strict=True)]
    head = f"{error.name}, {error.unit}"
    heads = (f"here: {head}", f"the protocol's own test: {head}")
    note = "The same weights on both; each interval is over the presses of its own test."
    return board_table(rows, heads, body, title="Beside the protocol's own test", notes=[note])


def _unsure(ranks: Ranks, rows: Sequence[Row]) -> str:
    """Return a sentence on the rows whose rank is better than that of a smaller error, or ""."""
    if not ranks.unsure:
        return ""
    labels = "; ".join(rows[k].label for k in sorted(ranks.unsure))
    return (
        f"These rows share the rank of a row with a smaller error, because their seeds scatter: "
        f"{labels}."
    )


def _first_value(row: Row, column: MetricColumn) -> tuple[bool, float]:
    pooled = row.metric(column.metric, column.group)
    return (True, 0.0) if pooled is None else (False, pooled.value)


def _metric_cell(row: Row, column: MetricColumn, spec: BoardTable) -> Cell:
    """Return a value over seeds; below it the share that qualifies it, and the seeds' sd."""
    if column.interpolated:  # "2 of 3" seeds with a value have one between the measured distances
        metrics = [record.metric(column.metric, column.group) for record in row.records]
        methods = [metric.method for metric in metrics if metric and metric.value is not None]
        return f"{methods.count('interpolated')} of {len(methods)}" if methods else None
    pooled = row.metric(column.metric, column.group)
    if pooled is not None and column.percent:
        pooled = replace(pooled, unit="share")
    share = spec.below.get(column.metric)
    part = None if share is None else row.metric(share, column.group)
    below = [] if part is None else [f"{number(100 * part.value, 0)} %"]
    if pooled is not None and pooled.sd is not None and column.spread:
        scale = 100.0 if pooled.unit == "share" else 1.0
        below.append(f"sd {number(scale * pooled.sd, column.decimals)}")
    return metric_number(pooled, column.decimals, interval=column.interval, below=", ".join(below))


def cost_table(rows: Sequence[Row]) -> Table | None:
    """Return speed and cost, a line for every row and machine."""
    parts = [part for row in rows for part in by_machine(row)]
    heads = (
        "p90, ms",
        "p50, ms",
        "p90, all threads, ms",
        "frames/s",
        "weights",
        "operations",
        "memory, MB",
        "training",
        "machine",
    )
    return board_table(parts, heads, [[*_costs(row)] for row in parts], title="Speed and cost")


def _costs(row: Row) -> Iterator[Cell]:
    yield p90(row)
    yield _mean(row, lambda r: latency(r, threads=1, statistic="p50_ms"), significant)
    yield _mean(row, lambda r: latency(r, threads=None), significant)
    yield _mean(row, frames_per_second, fixed(0))
    yield _mean(row, lambda r: r.efficiency.parameters, scaled)
    yield _mean(row, lambda r: r.efficiency.flops_per_frame, scaled)
    yield _mean(row, lambda r: r.efficiency.peak_memory_mb, fixed(0))
    yield _mean(row, lambda r: r.training.seconds, duration)
    yield Text(machine(row.first), "code")


def p90(row: Row) -> Number | None:
    """Return the p90 of one frame on one thread, ms; a star marks a time that is not settled."""
    mean = _mean(row, lambda record: latency(record, threads=1), significant)
    return mean if mean is None or settled(row) else replace(mean, mark="*")


def _mean(row: Row, quantity: Callable[[Record], float | None], write: Format) -> Number | None:
    """Return the mean over seeds, with their standard deviation below."""
    values = row.over(quantity)
    if not values:
        return None
    sd = statistics.stdev(values) if len(values) > 1 else 0.0
    return Number(statistics.fmean(values), write, below=f"sd {significant(sd, 2)}" if sd else "")


def curve_table(curves: Sequence[Curve], error: Ranking) -> Table | None:
    """Return the learning curves with a column for every number of presses; None without curves."""
    if not curves:
        return None
    presses = counts(curves)
    body: list[list[Cell]] = []
    for curve in curves:
        steps = {step.presses: step for step in curve.steps}
        cells: list[Cell] = [curve.label]
        for step in map(steps.get, presses):
            sd = None if step is None or step.error is None else step.error.sd
            below = "" if sd is None else f"sd {number(sd, error.decimals)}"
            pooled = None if step is None else step.error
            cells.append(metric_number(pooled, error.decimals, below=below))
        body.append(cells)
    note = (
        f"{error.name[0].upper()}{error.name[1:]}, {error.unit}, by the presses that a model "
        "learned from; the validation presses are the same in all."
    )
    heads: list[Head] = ["model", *(Column(f"{n:,}") for n in presses)]
    return table(heads, body, title="Learning curve", notes=[note])


def hard_case_tables(rows: Sequence[Row], axes: Sequence[Axis]) -> list[Table | None]:
    """Return where errors double: by families that change the press, and by families of faults."""
    families = [family_errors(row, axes) for row in rows]
    pressed = [a for a in axes if a.ordered and a.reference.startswith(f"{a.family}:")]
    faults = [axis for axis in axes if axis.ordered and axis not in pressed]
    tables = []
    for what, shown in (("what is pressed", pressed), ("the camera and its light", faults)):
        body = [
            [doubling_number(grade.doubles) for grade in grades if grade.axis in shown]
            for grades in families
        ]
        heads, title = [family_head(axis) for axis in shown], f"Where the error doubles: {what}"
        tables.append(board_table(rows, heads, body, title=title, notes=[DOUBLING_NOTE]))
    return tables


def family_head(axis: Axis) -> str:
    """Return the name of a family with its unit, such as "grazing, mm"."""
    return f"{axis.family}, {axis.unit}" if axis.unit else axis.family


def doubling_number(pooled: PooledMetric | None) -> Number | None:
    """Return the value at which an error doubles: "0.21" with its interval, or "> 6.5"."""
    if pooled is None:
        return None
    return Number(pooled.value, general, (pooled.low, pooled.high), pooled.censored or "")


def family_table(row: Row, axes: Sequence[Axis]) -> Table:
    """Return the errors of one row on the easy and the hardest case of every family."""
    heads: list[Head] = [
        "family",
        *map(Column, ("easy", "mm", "hardest", "mm", "missed, %", "worst ratio")),
        "doubles at",
    ]
    title = "Error by family, from the easy case to the hardest"
    return table(heads, [_family_cells(grade) for grade in family_errors(row, axes)], title=title)


def _family_cells(grade: FamilyErrors) -> list[Cell]:
    first, last = grade.cases[0], grade.cases[-1]
    graded = len(grade.cases) > 1
    return [
        family_head(grade.axis),
        f"{first.value:g}" if graded else "",
        _error(first) if graded else "",
        f"{last.value:g}" if graded else "",
        _error(last),
        "" if last.missed is None else Number(100 * last.missed.value, fixed(1)),
        "" if grade.worst is None else Number(grade.worst.value, fixed(1)),
        doubling_number(grade.doubles) if grade.axis.ordered else "",
    ]


def _error(case: Case) -> Number | None:
    return None if case.error is None else Number(case.error.value, fixed(3))


def doubling_table(rows: Sequence[Row], axes: Sequence[Axis]) -> Table:
    """Return the values at which errors double: one row a family, one column a model."""
    families = [family_errors(row, axes) for row in rows]
    few = len(rows) <= WITH_INTERVALS
    body: list[list[Cell]] = []
    for k, axis in enumerate(axes):
        if axis.ordered:
            numbers = [doubling_number(grades[k].doubles) for grades in families]
            shown = [n if n is None or few else replace(n, interval=None) for n in numbers]
            body.append([family_head(axis), f"{axis.easy:g} to {axis.values[-1]:g}", *shown])
    heads = ["family", "easy to hardest", *(row.label for row in rows)]
    title = "Where the error doubles" + (": value [95 % interval]" if few else "")
    return table(heads, body, title=title, notes=[DOUBLING_NOTE])


def overview_table(
    lines: Iterable[OverviewLine],
    *,
    interval: bool = True,
    regime: bool = True,
    link: Callable[[str], str] = lambda _: "",
) -> Table:
    """Return the overview as a table: one line for each model, over several boards.

    Args:
        lines: Lines of the overview, in their order.
        interval: Whether intervals stand below the values.
        regime: Whether a name says in which regime the model was trained.
        link: Makes the link to a row of the first protocol from its anchor.
    """
    spec = overview_spec()
    heads: list[Head] = [
        "model",
        "prior knowledge",
        *(Column(column.head) for column in spec.columns),
        Column("worst hard case: OSPA, mm"),
        Column("p90, one thread, ms"),
        Column("training"),
    ]
    rows: list[list[Cell]] = []
    for line in lines:
        row, worst = line.row, line.worst
        cells = (
            metric_number(value, column.decimals, interval=interval)
            for value, column in zip(line.values, spec.columns, strict=True)
        )
        name = Text(line_name(row, regime=regime), link=link(row_anchor(row)))
        hard = None if worst is None else Number(worst.error_mm, fixed(1), below=worst.family)
        costs = (p90(row), _mean(row, lambda record: record.training.seconds, duration))
        shown = (None if cost is None else replace(cost, below="") for cost in costs)
        rows.append([name, row.prior, *cells, hard, *shown])
    return table(heads, rows, title="Models over all boards", notes=[spec.note])


def line_name(row: Row, *, regime: bool = True) -> str:
    """Return the label of a row, with its training sensor where that is not the protocol's own."""
    default = load_protocol(row.first.protocol.id).spec.defaults.sensor
    sensor = row.first.sensor.text()
    label = label_of(row.first, regime=regime)
    return label if sensor == default else f"{label}, trained on {sensor}"


def published_table(paper: PublishedTable, protocol: str) -> Table | None:
    """Return the rows of a paper on a protocol, with its source and notes; None for none.

    Its columns are the metrics and groups that any of its rows has. No value has more decimals than
    the paper prints.
    """
    rows = rows_for(protocol, paper)
    if not rows:
        return None
    metrics = list(
        dict.fromkeys((m, g) for row in rows for m, groups in row.metrics.items() for g in groups)
    )
    rated = any(row.speed for row in rows)
    digits = {metric: _printed_decimals(metric, rows) for metric, _ in metrics}
    heads: list[Head] = ["model", "regime"]
    heads += [
        Column(PUBLISHED_HEADS.get(m, m) + ("" if g == "all" else f", {g}")) for m, g in metrics
    ]
    body: list[list[Cell]] = [
        [
            row.model,
            row.regime,
            *(published_number(row, m, g, digits[m]) for m, g in metrics),
            f"{row.n:,} {row.unit}" if row.n else None,
            *([_rate(row)] if rated else []),
            row.comparable,
            row.source,
        ]
        for row in rows
    ]
    source = f"{paper.authors}, {paper.title}, {paper.year}. Measured on: {paper.measured_on}."
    notes = (source, *dict.fromkeys((*(row.note for row in rows), *paper.notes)))
    heads += [Column("n"), *(["speed"] if rated else []), "comparable", "source"]
    return table(heads, body, title=paper.name, notes=notes)


def _rate(row: PublishedRow) -> str | None:
    speed = row.speed
    return None if speed is None else f"{speed.phase} {speed.per_s:g}/s, {speed.hardware}"


def _printed_decimals(metric: str, rows: Sequence[PublishedRow]) -> int:
    """Return the decimals that a paper prints of a metric: the most that any value has."""
    values = [value for row in rows for value in row.metrics.get(metric, {}).values()]
    digits = max((len(str(value).partition(".")[2]) for value in values), default=0)
    return max(digits - 2, 0) if is_share(metric) else digits
