"""Tables of a board: one row for each model in one configuration, its training seeds pooled."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

from tactibench.board import (
    Case,
    Curve,
    FamilyErrors,
    OverviewLine,
    PooledMetric,
    RankInterval,
    Ranks,
    Row,
    by_machine,
    counts,
    family_errors,
    frames_per_second,
    label_of,
    latency,
    machine,
    row_anchor,
    settled,
    shipped_models,
    unseen_error,
)
from tactibench.protocols import (
    Axis,
    BoardSpec,
    LoadedProtocol,
    PublishedRow,
    PublishedTable,
    Ranking,
    board_spec,
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
    error_words,
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
KNEW = {
    "plain addition": "addition",
    "nominal mechanics": "mechanics",
    "fitted to multi-contact labels": "pairs",
}
"""What a model knew of contacts before it saw a frame, in one word."""
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
    brief: bool = False,
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
        brief: Whether the names say what the model knew in one word, and no more.

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
        first = [] if ranks is None else [_rank(rank)]
        name = row_name(rows[k], details=ranks is not None, brief=brief)
        cells.append([*first, name, *(body[k][c] for c in used)])
    left_out = len(rows) - len(shown)
    gaps = f"{plural(left_out, 'row')} without a value not shown." if left_out else ""
    first_heads = ["model"] if ranks is None else [Column("rank"), "model"]
    columns = [*first_heads, *(Column(heads[c]) for c in used)]
    anchors = () if ranks is None else [row_anchor(rows[k]) for k in shown]
    return table(columns, cells, title=title, notes=(*notes, gaps), anchors=anchors)


def _rank(rank: RankInterval | None) -> Number | None:
    """Return the places between which chance decides; they are sorted by the first of them."""
    return None if rank is None else Number(rank.best, lambda _: str(rank))


def row_name(row: Row, *, details: bool = False, brief: bool = False) -> Text:
    """Return the label of a row, in italics for a trivial model.

    Args:
        row: The row.
        details: Whether prior knowledge, the number of seeds and who reproduced it stand below.
        brief: Whether what the model knew stands below, in one word, and of a model that does not
            ship who reproduced the row.
    """
    label = f"{row.label} {BELOW}" if row.below_bound else row.label
    words = [f"knew {KNEW[row.prior]}"] if row.prior in KNEW and (details or brief) else []
    if details and not brief:
        words += [plural(len(row.records), "seed"), row.reproduced]
    elif brief and row.first.model.name not in shipped_models():
        words.append(row.reproduced)
    return Text(label, "italic" if row.trivial else "", ", ".join(words))


def default_places(rows: Sequence[Row]) -> list[int]:
    """Return the places of one row of each model and regime: that at the defaults, or its best.

    Args:
        rows: Rows in the order of the board.
    """
    chosen: dict[tuple[str, str], int] = {}
    for k in sorted(range(len(rows)), key=lambda k: not rows[k].default):
        chosen.setdefault((rows[k].first.model.name, rows[k].regime), k)
    return sorted(chosen.values())


def shown_errors(protocol: LoadedProtocol) -> list[Ranking]:
    """Return the errors of a short table: what ranks, the depth, and the error on unseen sensors.

    Returns:
        [] where no error ranks the protocol.
    """
    spec = board_spec(protocol.spec.id)
    wanted = spec.ranking, spec.depth, unseen_error(protocol)
    return [error for error in wanted if error is not None] if spec.ranking else []


def summary_table(
    rows: Sequence[Row], ranks: Ranks, errors: Sequence[Ranking], title: str
) -> Table | None:
    """Return the table of a board's page: seven columns, or fewer where nothing was measured.

    Args:
        rows: Rows, in the order of the table.
        ranks: Their ranks.
        errors: The error that ranks the board, and others beside it; with three of them the time
            of training is left out.
        title: Heading of the table.
    """
    error = errors[0]
    misses = {"missed": "missed, %", "coverage": "answered, %"}
    found = (name for name in misses if any(row.metric(name, error.group) for row in rows))
    name = next(found, "missed")
    heads = [error_words(one, None)[0] for one in errors]
    costs = ("p90, ms", "training")[: 4 - len(errors)]
    heads += [misses[name], *costs]
    body: list[list[Cell]] = []
    for row in rows:
        values = [error_words(one, row.metric(one.metric, one.group))[1] for one in errors]
        missed = metric_number(row.metric(name, error.group), 2, interval=False)
        body.append([*values, missed, *_brief_costs(row)[: len(costs)]])
    pooled = (row.metric(error.metric, error.group) for row in rows)
    presses = span([count for one in pooled if one is not None for count in one.clusters])
    notes = [f"{presses} presses.", ranks.note]
    return board_table(rows, heads, body, title=title, notes=notes, ranks=ranks, brief=True)


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


def metric_table(
    spec: BoardTable, rows: Sequence[Row], ranks: Ranks | None = None, unit: str = "presses"
) -> Table | None:
    """Return the table of a board; None where no row has its first column.

    Args:
        spec: Metrics of the table.
        rows: Rows, in the order of the table.
        ranks: Ranks of the rows; None: they are not ranked here.
        unit: What the intervals are over.
    """
    first = spec.columns[0]
    pooled = [row.metric(first.metric, first.group) for row in rows]
    if spec.optional and not any(pooled):
        return None
    heads = [column.head for column in spec.columns]
    body: list[list[Cell]] = [[_metric_cell(row, c, spec) for c in spec.columns] for row in rows]
    presses = [count for value in pooled if value is not None for count in value.clusters]
    counted = f"{span(presses)} {unit}." if presses else ""
    notes = (spec.note, counted, "" if ranks is None else ranks.note)
    return board_table(rows, heads, body, title=spec.title, notes=notes, ranks=ranks)


def _metric_cell(row: Row, column: MetricColumn, spec: BoardTable) -> Cell:
    """Return a value over seeds; below it the share that qualifies it, and the seeds' sd."""
    pooled = row.metric(column.metric, column.group)
    if pooled is not None and column.percent:
        pooled = replace(pooled, unit="share")
    share = spec.below.get(column.metric)
    part = None if share is None else row.metric(share, column.group)
    below = [] if part is None else [f"{number(100 * part.value, 0)} %"]
    if pooled is not None and pooled.sd is not None and column.spread:
        scale = 100.0 if pooled.unit == "share" else 1.0
        below.append(f"sd {number(scale * pooled.sd, column.decimals)}")
    if pooled is not None and pooled.limits:
        below.append(pooled.limits)
    return metric_number(pooled, column.decimals, interval=column.interval, below=", ".join(below))


def cost_table(rows: Sequence[Row]) -> Table | None:
    """Return speed and cost, a line for every row and machine."""
    columns: dict[str, Callable[[Row], Cell]] = {
        "p90, ms": p90,
        "p50, ms": lambda row: _mean(
            row, partial(latency, threads=1, statistic="p50_ms"), significant
        ),
        "p90, all threads, ms": lambda row: _mean(row, partial(latency, threads=None), significant),
        "frames/s": lambda row: _mean(row, frames_per_second, fixed(0)),
        "weights": lambda row: _mean(row, lambda r: r.efficiency.parameters, scaled),
        "operations": lambda row: _mean(row, lambda r: r.efficiency.flops_per_frame, scaled),
        "memory, MB": lambda row: _mean(row, lambda r: r.efficiency.peak_memory_mb, fixed(0)),
        "training": lambda row: _mean(row, lambda r: r.training.seconds, duration),
        "machine": lambda row: Text(machine(row.first), "code"),
    }
    parts = [part for row in rows for part in by_machine(row)]
    body = [[write(row) for write in columns.values()] for row in parts]
    return board_table(parts, list(columns), body, title="Speed and cost")


def p90(row: Row) -> Number | None:
    """Return the p90 of one frame on one thread, ms; a star marks a time that is not settled."""
    mean = _mean(row, lambda record: latency(record, threads=1), significant)
    return mean if mean is None or settled(row) else replace(mean, mark="*")


def _brief_costs(row: Row) -> list[Cell]:
    """Return p90 and time of training, without their spread."""
    costs = (p90(row), _mean(row, lambda record: record.training.seconds, duration))
    return [None if cost is None else replace(cost, below="") for cost in costs]


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


def family_head(axis: Axis) -> str:
    """Return the name of a family with its unit, such as "grazing, mm"."""
    return f"{axis.family}, {axis.unit}" if axis.unit else axis.family


def doubling_number(pooled: PooledMetric | None) -> Number | None:
    """Return the value at which an error doubles: "0.21" with its interval, or "> 6.5"."""
    if pooled is None:
        return None
    interval = (pooled.low, pooled.high)
    return Number(pooled.value, general, interval, pooled.censored or "", pooled.limits)


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
    brief: bool = False,
    link: Callable[[str], str] = lambda _: "",
) -> Table:
    """Return the overview as a table: one line for each model, over several boards.

    Args:
        lines: Lines of the overview, in their order.
        brief: Whether models at their defaults alone are shown, in six columns without intervals.
        link: Makes the link to a row of the first protocol from its anchor.
    """
    spec, lines = overview_spec(), list(lines)
    measured = [any(line.values[k] is not None for line in lines) for k in range(len(spec.columns))]
    shown = [k for k, c in enumerate(spec.columns) if c.brief or (measured[k] and not brief)]
    heads: list[Head] = ["model", *(Column(spec.columns[k].head) for k in shown)]
    heads += [Column("p90, one thread, ms"), *([] if brief else [Column("training")])]
    rows: list[list[Cell]] = []
    for line in lines:
        name = line_name(line.row)
        if brief and name != line.row.first.model.name:
            continue
        known = row_name(line.row, brief=True)
        columns = ((line.values[k], spec.columns[k].decimals) for k in shown)
        cells = (metric_number(value, digits, interval=not brief) for value, digits in columns)
        costs = _brief_costs(line.row)
        shown_name = replace(known, text=name, link="" if brief else link(row_anchor(line.row)))
        rows.append([shown_name, *cells, *(costs[:1] if brief else costs)])
    return table(heads, rows, title="Models over all boards", notes=[spec.note])


def line_name(row: Row) -> str:
    """Return the label of a row, with its training sensor where that is not the protocol's own."""
    default = load_protocol(row.first.protocol.id).spec.defaults.sensor
    sensor, label = row.first.sensor.text(), label_of(row.first)
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
