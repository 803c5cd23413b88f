"""The table of the overview: one line for each model, over several boards."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable

from tactibench.board import OverviewLine, Row, label_of, latency, row_anchor, settled
from tactibench.protocols import load_protocol, overview_spec
from tactibench.report.numbers import duration, fixed, significant
from tactibench.report.table import Cell, Column, Head, Number, Table, Text, metric_number, table

TITLE = "Models over all boards"


def overview_table(
    lines: Iterable[OverviewLine],
    *,
    interval: bool = True,
    regime: bool = True,
    link: Callable[[str], str] = lambda _: "",
) -> Table:
    """Return the overview as a table.

    Args:
        lines: Lines of the overview, in their order.
        interval: Whether intervals stand below the values.
        regime: Whether a name says in which regime the model was trained.
        link: Makes the link to a row of the first protocol from its anchor.
    """
    spec = overview_spec()
    heads: list[Head] = [
        Column("model", right=False, who=True),
        "prior knowledge",
        *(Column(column.head) for column in spec.columns),
        Column("worst hard case: OSPA, mm"),
        Column("p90, one thread, ms"),
        Column("training"),
    ]
    rows = []
    for line in lines:
        values = (
            metric_number(value, column.decimals, interval=interval)
            for value, column in zip(line.values, spec.columns, strict=True)
        )
        name = Text(line_name(line.row, regime=regime), link=link(row_anchor(line.row)))
        rows.append([name, line.row.prior, *values, _worst(line), *_costs(line.row)])
    return table(heads, rows, title=TITLE, note=spec.note)


def line_name(row: Row, *, regime: bool = True) -> str:
    """Return the label of a row, with its training sensor where that is not the protocol's own."""
    default, sensor = (
        load_protocol(row.first.protocol.id).spec.defaults.sensor,
        row.first.sensor.text(),
    )
    return label_of(row.first, regime=regime) + (
        "" if sensor == default else f", trained on {sensor}"
    )


def _worst(line: OverviewLine) -> Cell:
    if line.worst is None:
        return None
    return Number(line.worst.error_mm, fixed(1), below=line.worst.family)


def _costs(row: Row) -> tuple[Cell, Cell]:
    times = row.over(lambda record: latency(record, threads=1))
    training = row.over(lambda record: record.training.seconds)
    mark = "" if settled(row) else "*"
    return (
        Number(statistics.fmean(times), significant, mark=mark) if times else None,
        Number(statistics.fmean(training), duration) if training else None,
    )
