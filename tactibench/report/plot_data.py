"""Figures over many runs and the numbers behind them, which notebooks draw and terminals print.

The runs are the committed records of a board, and the complete runs of a store. Seeds are pooled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactibench.board import (
    Row,
    all_records,
    curves,
    frontiers,
    gather_records,
    new_sensor_curves,
    ordered,
    ranking_error,
    sections_of,
    select_section,
    whole,
)
from tactibench.board.sections import left_out
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols import load_protocol
from tactibench.report.hard_cases import doubling_table
from tactibench.report.numbers import plural
from tactibench.report.plot_tables import (
    JsonRows,
    curve_rows,
    curve_steps_table,
    frontier_remarks,
    frontier_rows,
    frontier_table,
    new_sensor_table,
    stability_rows,
)
from tactibench.report.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        draw_detail: Draws the curves behind a heat map; None where there is no such figure.
        document: JSON values for ``--json``; None: the rows.
    """

    title: str
    subject: str
    tables: tuple[Table, ...]
    rows: JsonRows = field(repr=False)
    draw: Callable[[], Figure] = field(repr=False)
    remarks: tuple[str, ...] = ()
    draw_detail: Callable[[], Figure] | None = field(default=None, repr=False)
    document: dict[str, Any] | None = field(default=None, repr=False)


def frontier_data(
    protocol: str, board: Path, runs: Path | None, sensor: str | None, machine: str | None
) -> PlotData:
    """Return the models that are fast for their error, by regime.

    Args:
        protocol: Name of the protocol.
        board: Folder of the leaderboards.
        runs: A run store; None: none.
        sensor: Name of the sensor; None: the nominal one.
        machine: Fingerprint of the machine; None: that of most runs.

    Raises:
        UserError: There is nothing to show.
    """
    records = whole(gather_records(protocol, board, runs))
    section = select_section(records, sensor, protocol)
    error = ranking_error(protocol)
    regimes = frontiers(section.rows, error, _known_machine(machine, section.rows))
    timed = [point for regime in regimes for point in regime.points]
    subject = f"{protocol}, {section.title.lower()}"
    if timed:
        subject += f", timed on {timed[0].row.first.environment.cpu} ({regimes[0].machine})"
    remarks = list(frontier_remarks(regimes))
    if hidden := left_out(records, section):
        remarks.append(f"Left out: {plural(hidden, 'run')} on other sensors.")

    def draw() -> Figure:
        from tactibench.report.plots.frontier import frontier_figure, off_nominal

        everywhere = sections_of(whole(all_records(protocol, board, runs)))
        other = off_nominal(protocol, section, everywhere, regimes)
        return frontier_figure(regimes, error, off_nominal=other, measured_on=subject)

    return PlotData(
        f"Speed against {error.name}",
        subject,
        tuple(frontier_table(regime, error) for regime in regimes),
        [line for regime in regimes for line in frontier_rows(regime, error)],
        draw,
        tuple(remarks),
    )


def _known_machine(machine: str | None, rows: Sequence[Row]) -> str | None:
    from tactibench.board import machine as machine_of

    machines = sorted({machine_of(record) for row in rows for record in row.records})
    if machine is not None and machine not in machines:
        raise UserError(
            f"no run was timed on a machine {machine!r}; {did_you_mean(machine, machines)}"
        )
    return machine


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
        return _new_sensor_data(protocol, board, runs, sensor)
    section = select_section(gather_records(protocol, board, runs), sensor, protocol)
    learning = curves(section.rows, error)
    if not learning:
        raise UserError(
            f"no configuration of {protocol} was run with several numbers of presses; make some "
            f"with `tactibench run {protocol} --presses N`."
        )
    subject = f"{protocol}, {section.title.lower()}"

    def draw() -> Figure:
        from tactibench.report.plots.curve import curve_figure

        return curve_figure(learning, error, measured_on=subject)

    shown = (curve_steps_table(learning, error),)
    return PlotData("", subject, shown, curve_rows(learning, error), draw)


def _new_sensor_data(protocol: str, board: Path, runs: Path | None, sensor: str | None) -> PlotData:
    error = ranking_error(protocol)
    name = sensor or load_protocol(protocol).spec.defaults.sensor
    learning = new_sensor_curves(all_records(protocol, board, runs), error, name)
    if not learning:
        raise UserError(
            f"no run of {protocol} on sensor {name!r} was tested on another instance than it was "
            f"trained on; make some with `tactibench run {protocol} --test sensor.instance=1`."
        )
    subject = f"{protocol}, simulated sensor {name}, instances that no training saw"

    def draw() -> Figure:
        from tactibench.report.plots.curve import NEW_SENSOR, curve_figure

        return curve_figure(learning, error, NEW_SENSOR, measured_on=subject)

    shown = (new_sensor_table(learning, error),)
    return PlotData("", subject, shown, curve_rows(learning, error), draw)


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
    chosen = _rows_named(ordered(protocol, section.rows), labels)
    subject = f"{protocol}, {section.title.lower()}"

    def draw() -> Figure:
        from tactibench.report.plots.doubling import doubling_figure

        return doubling_figure(chosen, axes, measured_on=subject)

    def draw_cases() -> Figure:
        from tactibench.report.plots.stability import stability_figure
        from tactibench.report.plots.style import CURVES

        if len(chosen) > CURVES:
            raise UserError(
                f"{len(chosen)} rows are too many for one panel; name at most {CURVES} with "
                "--rows LABEL."
            )
        return stability_figure(chosen, axes, measured_on=subject)

    shown = (doubling_table(chosen, axes),)
    rows = stability_rows(chosen, axes)
    return PlotData("", subject, shown, rows, draw, draw_detail=draw_cases)


def _rows_named(rows: Sequence[Row], labels: tuple[str, ...]) -> list[Row]:
    by_label = {row.label: row for row in rows}
    for label in labels:
        if label not in by_label:
            raise UserError(f"no row is called {label!r}; {did_you_mean(label, by_label)}")
    return [by_label[label] for label in labels] if labels else list(rows)
