"""Figures over many runs and the numbers behind them, which notebooks draw and terminals print.

The runs are the committed records of a board, and the complete runs of a store. Seeds are pooled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from tactibench.board import (
    Curve,
    Frontier,
    Range,
    Row,
    all_records,
    count_left_out,
    curves,
    family_errors,
    frontiers,
    gather_records,
    machine,
    new_sensor_curves,
    ordered,
    ranking_error,
    select_section,
    settled,
    whole,
)
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols import Axis, Ranking, load_protocol
from tactibench.report.board_tables import curve_table, doubling_table
from tactibench.report.curve_plots import (
    LEARNING,
    NEW_SENSOR,
    curve_figure,
    stability_figure,
)
from tactibench.report.frontier_plot import frontier_figure, unseen_frontiers
from tactibench.report.style import CURVES
from tactibench.report.tables import (
    Column,
    Format,
    Head,
    Number,
    Table,
    fixed,
    plural,
    significant,
    table,
)

JsonRows = list[dict[str, Any]]
FRONTIER_NOTE = (
    "Range: from the lowest end of the seeds' intervals to the highest; a time is at "
    "least 2 % wide. Dominated: another of the same regime is better on both by more than "
    "the ranges. *: the time is not settled. Trivial rows are left out."
)


@dataclass(frozen=True)
class PlotData:
    """A figure, drawn on request, with its numbers.

    Attributes:
        title: Title of the figure; "" where the tables say it.
        subject: Protocol, sensor and machine.
        tables: The numbers, as a reader sees them.
        remarks: Sentences on how to read the numbers, and what they leave out.
        rows: The numbers, one mapping a point.
        draw: Draws the figure.
    """

    title: str
    subject: str
    tables: tuple[Table, ...]
    rows: JsonRows = field(repr=False)
    draw: Callable[[], Figure] = field(repr=False)
    remarks: tuple[str, ...] = ()


def frontier_data(
    protocol: str, board: Path, runs: Path | None, sensor: str | None, fingerprint: str | None
) -> PlotData:
    """Return the models that are fast for their error, by regime.

    Args:
        protocol: Name of the protocol.
        board: Folder of the leaderboards.
        runs: A run store; None: none.
        sensor: Name of the sensor; None: the nominal one.
        fingerprint: Fingerprint of the machine; None: that of most runs.

    Raises:
        UserError: There is nothing to show.
    """
    records = whole(gather_records(protocol, board, runs))
    section = select_section(records, sensor, protocol)
    error = ranking_error(protocol)
    machines = sorted({machine(record) for row in section.rows for record in row.records})
    if fingerprint is not None and fingerprint not in machines:
        raise UserError(
            f"no run was timed on a machine {fingerprint!r}; {did_you_mean(fingerprint, machines)}"
        )
    regimes = frontiers(section.rows, error, fingerprint)
    timed = [point for regime in regimes for point in regime.points]
    subject = f"{protocol}, {section.title.lower()}"
    if timed:
        subject += f", timed on {timed[0].row.first.environment.cpu} ({regimes[0].machine})"
    remarks = list(_frontier_remarks(regimes))
    if hidden := count_left_out(records, section):
        remarks.append(f"Left out: {plural(hidden, 'run')} on other sensors.")

    def draw() -> Figure:
        unseen = unseen_frontiers(protocol, section, regimes)
        return frontier_figure(regimes, error, unseen=unseen, measured_on=subject)

    return PlotData(
        f"Speed against {error.name}",
        subject,
        tuple(frontier_table(regime, error) for regime in regimes),
        [line for regime in regimes for line in _frontier_rows(regime, error)],
        draw,
        tuple(remarks),
    )


def frontier_table(frontier: Frontier, error: Ranking) -> Table:
    """Return the points of one regime as a table, sorted by latency."""

    def ranged(value: Range, write: Format, mark: str = "") -> Number:
        return Number(value.value, write, (value.low, value.high), mark=mark)

    heads: list[Head] = [
        f"regime {frontier.regime}",
        Column("seeds"),
        "p90 and range, ms",
        f"error and range, {error.unit}",
        "",
    ]
    rows = [
        (
            point.label,
            str(len(point.row.records)),
            ranged(point.latency, significant, "" if settled(point.row) else "*"),
            ranged(point.error, fixed(error.decimals)),
            frontier.verdict(point),
        )
        for point in frontier.points
    ]
    return table(heads, rows)


def _frontier_remarks(regimes: Sequence[Frontier]) -> Iterator[str]:
    """Yield how to read the tables and what they leave out, one sentence each."""
    yield FRONTIER_NOTE
    if elsewhere := sum(frontier.elsewhere for frontier in regimes):
        here = regimes[0].machine
        yield f"Left out: {plural(elsewhere, 'run')} timed on another machine than {here}."
    untimed = [f"{name} ({regime.regime})" for regime in regimes for name in regime.untimed]
    if untimed:
        yield f"Left out, without an error or a time: {'; '.join(untimed)}."


def _frontier_rows(frontier: Frontier, error: Ranking) -> Iterator[dict[str, Any]]:
    """Yield two tidy rows for every point: its latency and its error."""
    for point in frontier.points:
        for metric, value, unit in (
            ("p90_ms", point.latency, "ms"),
            (error.metric, point.error, error.unit),
        ):
            yield {
                "metric": metric,
                "group": point.label,
                "value": value.value,
                "low": value.low,
                "high": value.high,
                "unit": unit,
                "dominated_by": list(frontier.dominated.get(point.label, ())),
                "on_frontier": point in frontier.best,
                "regime": frontier.regime,
                "machine": frontier.machine,
                "seeds": list(point.row.seeds),
            }


def curve_data(
    protocol: str, board: Path, runs: Path | None, sensor: str | None, *, new_sensor: bool
) -> PlotData:
    """Return the learning curves of a protocol.

    Args:
        protocol: Name of the protocol.
        board: Folder of the leaderboards.
        runs: A run store; None: none.
        sensor: Name of the sensor; None: the nominal one.
        new_sensor: Whether the curves are against the labelled presses of a sensor instance that no
            training saw.

    Raises:
        UserError: There is nothing to show.
    """
    error = ranking_error(protocol)
    if new_sensor:
        name = sensor or load_protocol(protocol).spec.defaults.sensor
        learning = new_sensor_curves(all_records(protocol, board, runs), error, name)
        lacking = (
            f"no run of {protocol} on sensor {name!r} was tested on another instance than it was "
            f"trained on; make some with `tactibench run {protocol} --test sensor.instance=1`."
        )
        subject = f"{protocol}, simulated sensor {name}, instances that no training saw"
    else:
        section = select_section(gather_records(protocol, board, runs), sensor, protocol)
        learning = curves(section.rows, error)
        lacking = (
            f"no configuration of {protocol} was run with several numbers of presses; make some "
            f"with `tactibench run {protocol} --presses N`."
        )
        subject = f"{protocol}, {section.title.lower()}"
    if not learning:
        raise UserError(lacking)

    def draw() -> Figure:
        caption = NEW_SENSOR if new_sensor else LEARNING
        return curve_figure(learning, error, caption, measured_on=subject)

    shown = tuple(filter(None, [curve_table(learning, error)]))
    return PlotData("", subject, shown, _curve_rows(learning, error), draw)


def _curve_rows(learning: Sequence[Curve], error: Ranking) -> JsonRows:
    """Return a tidy row for every step of every curve."""
    return [
        {
            "metric": error.metric,
            "group": curve.label,
            "presses": step.presses,
            "value": step.error and step.error.value,
            "low": step.error and step.error.low,
            "high": step.error and step.error.high,
            "sd": step.error and step.error.sd,
            "unit": error.unit,
            "seeds": step.seeds,
        }
        for curve in learning
        for step in curve.steps
    ]


def stability_data(
    protocol: str, board: Path, runs: Path | None, sensor: str | None, labels: tuple[str, ...]
) -> PlotData:
    """Return the value at which the error of every model doubles on graded hard cases.

    Args:
        protocol: Name of the protocol.
        board: Folder of the leaderboards.
        runs: A run store; None: none.
        sensor: Name of the sensor; None: the nominal one.
        labels: Labels of the rows that are shown, in this order; () for all.

    Raises:
        UserError: There is nothing to show.
    """
    axes = load_protocol(protocol).spec.axes
    if not axes:
        raise UserError(f"{protocol} has no families of hard cases; take stability.")
    section = select_section(whole(gather_records(protocol, board, runs)), sensor, protocol)
    chosen = ordered(protocol, section.rows)
    by_label = {row.label: row for row in chosen}
    for label in labels:
        if label not in by_label:
            raise UserError(f"no row is called {label!r}; {did_you_mean(label, by_label)}")
    chosen = [by_label[label] for label in labels] or list(chosen)
    subject = f"{protocol}, {section.title.lower()}"
    rows = list(_stability_rows(chosen, axes))
    return PlotData(
        "",
        subject,
        (doubling_table(chosen, axes),),
        rows,
        partial(stability_figure, chosen[:CURVES], axes, measured_on=subject),
        () if len(chosen) <= CURVES else (f"The picture shows the first {CURVES} rows.",),
    )


def _stability_rows(rows: Sequence[Row], axes: Sequence[Axis]) -> Iterator[dict[str, Any]]:
    """Yield the values at which errors double, and the errors case by case."""
    for row in rows:
        for grade in family_errors(row, axes):
            axis, doubles = grade.axis, grade.doubles
            subject = {"group": row.label, "family": axis.family}
            if doubles is not None:
                ends = {"value": doubles.value, "low": doubles.low, "high": doubles.high}
                facts = {"censored": doubles.censored, "unit": axis.unit, "harder": axis.harder}
                yield {"metric": "doubles_at", **subject, **ends, **facts}
            for case in grade.cases:
                if case.error is not None:
                    error = case.error
                    ends = {"value": error.value, "low": error.low, "high": error.high}
                    place = {"at": case.value, "easy": case.easy}
                    yield {"metric": "ospa_mm", **subject, **place, **ends, "unit": "mm"}
