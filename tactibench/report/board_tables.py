"""Tables of a board: one row for each model in one configuration, its training seeds pooled."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from tactibench.board import (
    Curve,
    FittedFrames,
    PooledMetric,
    Ranks,
    Row,
    Step,
    by_machine,
    counts,
    fitted_frames,
    frames_per_second,
    latency,
    machine,
    row_anchor,
    settled,
)
from tactibench.protocols import Block as BoardTable
from tactibench.protocols import BoardSpec, Ranking
from tactibench.protocols import Column as MetricColumn
from tactibench.records import Record
from tactibench.report.document import Block, Bullets, Group, Prose
from tactibench.report.labels import named
from tactibench.report.numbers import (
    Format,
    duration,
    fixed,
    number,
    plural,
    scaled,
    significant,
    span,
)
from tactibench.report.table import Cell, Column, Head, Number, Table, Text, metric_number, table

IDENTITY = (
    Column("model", right=False, who=True),
    Column("encoder", right=False, detail=True),
    Column("regime", right=False, detail=True),
    Column("prior knowledge", right=False, detail=True),
    Column("seeds", detail=True),
)
FITTED = Column(
    "labelled frames besides",
    title="labelled frames of the tested sensor to which something else was fitted: a simulator, "
    "offset and pivot of its labels",
)
BELOW = "†"
"""Marks a model whose errors are below the Cramer-Rao bound."""


def identity(row: Row) -> list[Cell]:
    """Return the cells of IDENTITY; trivial models are in italics."""
    prior = "" if row.prior == "none" else f"prior knowledge: {row.prior}"
    details = (row.encoder, row.regime, prior, plural(len(row.records), "seed"))
    model = f"{row.model} {BELOW}" if row.below_bound else row.model
    return [
        Text(model, "italic" if row.trivial else "", ", ".join(filter(None, details))),
        row.encoder or "none",
        row.regime,
        row.prior,
        seed_count(len(row.records)),
    ]


def seed_count(count: int) -> str:
    """Return "3", or "1 seed", which warns that nothing is known of the spread of seeds."""
    return "1 seed" if count == 1 else str(count)


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
    """Return the table of a board; None where it is optional and no row has its first column.

    Args:
        spec: Metrics of the table.
        rows: Rows, in the order of the table.
        ranks: Ranks of the rows, for a column before the others; None: no such column.
    """
    first = spec.columns[0]
    pooled = [row.metric(first.metric, first.group) for row in rows]
    if spec.optional and not any(pooled):
        return None
    if spec.sorted:
        rows = sorted(rows, key=lambda row: _first_value(row, first))
    heads: list[Column | str] = [*IDENTITY]
    for column in spec.columns:
        heads.append(Column(column.head))
        if column.spread:
            title = f"standard deviation over training seeds of {column.head}"
            heads.append(Column("sd", title=title, spread=True))
    body = [[*identity(row), *_metric_cells(row, spec)] for row in rows]
    fitted = [fitted_frames(row.first) for row in rows]
    if any(fitted):
        heads.insert(len(IDENTITY), FITTED)
        for cells, frames in zip(body, fitted, strict=True):
            cells.insert(len(IDENTITY), _fitted(frames))
    if ranks is not None:
        heads.insert(0, Column("rank"))
        body = [
            [rank if rank is None else Number(rank, fixed(0)), *cells]
            for rank, cells in zip(ranks.by_row, body, strict=True)
        ]
    presses = [count for value in pooled if value is not None for count in value.clusters]
    counted = f"{span(presses)} presses." if presses else ""
    ranking = () if ranks is None else (ranks.note, _unsure(ranks, rows))
    note = " ".join(filter(None, (counted, *ranking)))
    result = replace(table(heads, body, title=spec.title, note=note), guide=spec.note)
    linked = ranks is not None and not spec.apart  # a row has one place to link to
    return result if not linked else replace(result, anchors=tuple(map(row_anchor, rows)))


def own_test_table(rows: Sequence[Row], own: Sequence[Row | None], error: Ranking) -> Table | None:
    """Return the error of rows beside that of the same weights on the protocol's own test.

    Args:
        rows: Rows that were tested on something else.
        own: Rows of the same weights on the protocol's own test; None where there are none.
        error: Error that ranks the board.

    Returns:
        None where no row was tested on the protocol's own test.
    """
    if not any(own):
        return None

    def written(row: Row | None) -> Cell:
        pooled = None if row is None else row.metric(error.metric, error.group)
        return metric_number(pooled, error.decimals)

    body = [
        [*identity(tested), written(tested), written(on_own_test)]
        for tested, on_own_test in zip(rows, own, strict=True)
    ]
    head = f"{error.name}, {error.unit}"
    heads = [*IDENTITY, Column(f"here: {head}"), Column(f"the protocol's own test: {head}")]
    note = "The same weights on both; each interval is over the presses of its own test."
    return table(heads, body, title="Beside the protocol's own test", note=note)


def _unsure(ranks: Ranks, rows: Sequence[Row]) -> str:
    """Return a sentence on the rows whose rank is better than that of a smaller error, or ""."""
    if not ranks.unsure:
        return ""
    labels = "; ".join(rows[k].label for k in sorted(ranks.unsure))
    return (
        "Not told apart from the first row of their rank, although rows with a smaller error are: "
        f"{labels}."
    )


def _first_value(row: Row, column: MetricColumn) -> tuple[bool, float]:
    pooled = row.metric(column.metric, column.group)
    return (True, 0.0) if pooled is None else (False, pooled.value)


def _fitted(frames: FittedFrames | None) -> Cell:
    if frames is None:
        return Number(0, fixed(0))
    if frames.labels is None:
        return f"more than {frames.known:,}"
    return Number(frames.known, "{:,.0f}".format)


def _metric_cells(row: Row, spec: BoardTable) -> Iterator[Cell]:
    for column in spec.columns:
        if column.interpolated:
            yield _count_interpolated(row, column)
            continue
        pooled = row.metric(column.metric, column.group)
        if pooled is not None and column.percent:
            pooled = replace(pooled, unit="share")
        below = _share_below(row, column, spec)
        yield metric_number(pooled, column.decimals, interval=column.interval, below=below)
        if column.spread:
            yield _spread(pooled, column.decimals)


def _count_interpolated(row: Row, column: MetricColumn) -> str | None:
    """Return "2 of 3", the seeds with a value whose value is interpolated."""
    metrics = [record.metric(column.metric, column.group) for record in row.records]
    methods = [metric.method for metric in metrics if metric and metric.value is not None]
    return f"{methods.count('interpolated')} of {len(methods)}" if methods else None


def _spread(pooled: PooledMetric | None, decimals: int) -> Number | None:
    if pooled is None or pooled.sd is None:
        return None
    return Number(pooled.sd * (100.0 if pooled.unit == "share" else 1.0), fixed(decimals))


def _share_below(row: Row, column: MetricColumn, spec: BoardTable) -> str:
    """Return the share that qualifies an error and stands below it, or ""."""
    share = spec.below.get(column.metric)
    pooled = None if share is None else row.metric(share, column.group)
    return "" if pooled is None else f"{number(100 * pooled.value, 0)} %"


def cost_blocks(rows: Sequence[Row]) -> list[Block]:
    """Return the tables of latency and cost, folded behind a title."""
    parts = [part for row in rows for part in by_machine(row)]
    latencies = table(
        (
            *IDENTITY,
            Column("p90, ms"),
            Column("sd", title="standard deviation over training seeds of p90, ms", spread=True),
            *map(Column, ("p50, ms", "p90, all threads, ms", "frames/s", "to float32, mm")),
            "timed as",
            "machine",
        ),
        [[*identity(row), *_latency_cells(row)] for row in parts],
        title="Latency",
    )
    costs = table(
        (
            *IDENTITY,
            *map(Column, ("weights", "operations", "memory, MB", "training")),
            Column(
                "sd, s",
                title="standard deviation over training seeds of the training time",
                spread=True,
            ),
            "trained on",
            "machine",
        ),
        [[*identity(row), *_cost_cells(row)] for row in parts],
        title="Cost",
    )
    return [Group("Latency and cost", (latencies, costs))]


def machine_list(rows: Iterable[Row]) -> list[Block]:
    """Return the machines behind the fingerprints of timed rows."""
    records = (record for row in rows for record in row.records if record.speed)
    machines = {machine(record): record for record in records}
    named = tuple(
        (Text(name, "code"), Prose(": "), _machine(record))
        for name, record in sorted(machines.items())
    )
    return [Group("Machines", (Bullets(named),))] if named else []


def _latency_cells(row: Row) -> Iterator[Cell]:
    times = row.over(lambda record: latency(record, threads=1))
    mark = "" if settled(row) else "*"
    yield Number(statistics.fmean(times), significant, mark=mark) if times else None
    yield _deviation(times, lambda value: significant(value, 2))
    yield _mean(row, lambda r: latency(r, threads=1, statistic="p50_ms"), significant)
    yield _mean(row, lambda r: latency(r, threads=None), significant)
    yield _mean(row, frames_per_second, fixed(0))
    yield _mean(row, lambda record: record.timed.difference_mm, fixed(4))
    yield _each_once(row, lambda record: record.timed.configuration)
    yield Text(machine(row.first), "code")


def _cost_cells(row: Row) -> Iterator[Cell]:
    yield _mean(row, lambda record: record.efficiency.parameters, scaled)
    yield _mean(row, lambda record: record.efficiency.flops_per_frame, scaled)
    yield _mean(row, lambda record: record.efficiency.peak_memory_mb, "{:,.0f}".format)
    training = row.over(lambda record: record.training.seconds)
    yield Number(statistics.fmean(training), duration) if training else None
    yield _deviation(training, "{:,.0f}".format)
    yield _each_once(row, lambda record: record.training.device)
    yield Text(machine(row.first), "code")


def _mean(row: Row, quantity: Callable[[Record], float | None], write: Format) -> Number | None:
    values = row.over(quantity)
    return Number(statistics.fmean(values), write) if values else None


def _deviation(values: Sequence[float], write: Format) -> Number | None:
    """Return the sample standard deviation over seeds, None for one seed."""
    return Number(statistics.stdev(values), write) if len(values) > 1 else None


def _each_once(row: Row, words: Callable[[Record], str | None]) -> str:
    return "; ".join(sorted({words(record) or "n/a" for record in row.records}))


def _machine(record: Record) -> str:
    facts = record.environment
    parts = [
        facts.cpu,
        f"{facts.cores_logical} logical cores" if facts.cores_logical else None,
        ", ".join(facts.cpu_flags),
        *(facts.gpu),
        f"torch {facts.torch}" if facts.torch else None,
        facts.os,
    ]
    return "; ".join(part for part in parts if part)


def curve_table(curves: Sequence[Curve], error: Ranking) -> Table | None:
    """Return the learning curves with a column for every number of presses; None without curves."""
    if not curves:
        return None
    presses = counts(curves)
    body: list[list[Cell]] = []
    for curve in curves:
        steps = {step.presses: step for step in curve.steps}
        body.append([curve.label, *(_step_number(steps.get(n), error.decimals) for n in presses)])
    note = (
        f"{error.name[0].upper()}{error.name[1:]}, {error.unit}, by the presses that a model "
        "learned from; the validation presses are the same in all. Below: the 95 % interval, and "
        "the standard deviation over seeds, or how many there are."
    )
    heads: list[Head] = [
        Column("model", right=False, who=True),
        *(Column(f"{n:,}") for n in presses),
    ]
    return table(heads, body, title="Learning curve", note=note)


def _step_number(step: Step | None, decimals: int) -> Number | None:
    if step is None or step.error is None:
        return None
    sd = step.error.sd
    below = seed_count(step.seeds) if sd is None else f"sd {number(sd, decimals)}"
    return metric_number(step.error, decimals, below=below)
