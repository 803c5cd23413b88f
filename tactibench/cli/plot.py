"""``tactibench plot``: pictures over many runs, with their numbers as tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tactibench.cli.options import (
    add_options,
    board_option,
    json_option,
    picture_file,
    picture_option,
    save_json,
)
from tactibench.cli.plot_limit import limit
from tactibench.errors import UserError, did_you_mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactibench.board.rows import Row
    from tactibench.board.sections import Section
    from tactibench.cli.output import Terminal
    from tactibench.protocols.families import Axis
    from tactibench.records.record import Record


@click.group()
def plot() -> None:
    """Draw what many runs say together, and print the numbers behind the picture.

    \b
    tactibench plot frontier exp2 --out frontier.png     speed against error
    tactibench plot curve exp1 --out curve.png           error against training presses
    tactibench plot stability stability --out cases.png  where errors double on hard cases
    tactibench plot limit --out map.png                  the smallest errors that noise allows
    """


board_options = add_options(
    picture_option,
    board_option,
    click.option(
        "--store",
        "runs",
        type=click.Path(path_type=Path, file_okay=False, exists=True),
        help="Take the complete runs of this store, too.",
    ),
    click.option("--sensor", help="Such as 'tactip-127, instance=1'; default: the nominal one."),
    json_option,
)
"""Options that say which runs are drawn, and where picture and numbers go."""


@plot.command()
@click.argument("protocol")
@board_options
@click.option("--machine", help="Fingerprint of the machine; default: that of most runs.")
def frontier(
    protocol: str,
    out: Path | None,
    board_folder: Path,
    runs: Path | None,
    sensor: str | None,
    json_file: Path | None,
    machine: str | None,
) -> None:
    """Show which models of PROTOCOL are fast for their error, and which are dominated.

    From the committed records: the latency of one frame (p90, one thread, one machine) against the
    error that orders the board. Seeds are pooled.

    \b
    tactibench plot frontier exp2 --out docs/images/frontier-exp2.png
    """
    from tactibench.board.frontier import frontiers
    from tactibench.board.grouping import whole
    from tactibench.board.ranking import ranking_error
    from tactibench.board.sections import gather_records, left_out
    from tactibench.cli.output import Terminal
    from tactibench.report.plot_tables import frontier_remarks, frontier_rows, frontier_table
    from tactibench.report.writers.terminal import print_table

    records = whole(gather_records(protocol, board_folder, runs))
    section = _section(records, sensor, protocol)
    error = ranking_error(protocol)
    regimes = frontiers(section.rows, error, _known_machine(machine, section.rows))
    timed = [point for regime in regimes for point in regime.points]
    subject = f"{protocol}, {section.title.lower()}"
    if timed:
        subject += f", timed on {timed[0].row.first.environment.cpu} ({regimes[0].machine})"
    terminal = Terminal()
    _say_subject(terminal, f"Speed against {error.name}", subject)
    for regime in regimes:
        terminal.say("")
        print_table(terminal.out, frontier_table(regime, error))
    terminal.say("")
    for remark in frontier_remarks(regimes):
        terminal.say(remark)
    if hidden := left_out(records, section):
        terminal.say(f"Left out: {hidden:,} runs on other sensors.")
    if out is not None:
        from tactibench.report.plots.frontier import frontier_figure

        _save(terminal, frontier_figure(regimes, error, measured_on=subject), out)
    save_json(json_file, [line for regime in regimes for line in frontier_rows(regime, error)])


def _known_machine(machine: str | None, rows: Sequence[Row]) -> str | None:
    from tactibench.board.cost import machine as machine_of

    known = sorted({machine_of(record) for row in rows for record in row.records})
    if machine is not None and machine not in known:
        raise UserError(
            f"no run was timed on a machine {machine!r}; {did_you_mean(machine, known)}"
        )
    return machine


@plot.command()
@click.argument("protocol")
@board_options
@click.option(
    "--new-sensor",
    is_flag=True,
    help="Against the labelled presses of an instance that no training saw; --sensor: its name.",
)
def curve(
    protocol: str,
    *,
    out: Path | None,
    board_folder: Path,
    runs: Path | None,
    sensor: str | None,
    json_file: Path | None,
    new_sensor: bool,
) -> None:
    """Show the learning curves of PROTOCOL: the error that orders its board against presses.

    From runs with `--presses N` and the whole run of the same configuration. With --new-sensor,
    from runs that were tested on other instances of the sensor than they were trained on, after N
    labelled presses, beside runs that were trained on N presses of the instance alone.

    \b
    tactibench run exp1 --model unet --presses 250
    tactibench plot curve exp1 --store runs --out curve.png
    tactibench run exp1 --model kernel --param sensor.instances=16 \\
        --test sensor.instance=1 --test shots=50
    tactibench run exp1 --model kernel --param sensor.instance=1 --presses 50
    tactibench plot curve exp1 --new-sensor --store runs --out new.png
    """
    from tactibench.board.curve import curves
    from tactibench.board.ranking import ranking_error
    from tactibench.board.sections import gather_records
    from tactibench.cli.output import Terminal
    from tactibench.report.plot_tables import curve_rows, curve_steps_table
    from tactibench.report.writers.terminal import print_table

    error = ranking_error(protocol)
    if new_sensor:
        _new_sensor_curve(protocol, board_folder, runs, sensor, out, json_file)
        return
    section = _section(gather_records(protocol, board_folder, runs), sensor, protocol)
    learning = curves(section.rows, error)
    if not learning:
        raise UserError(
            f"no configuration of {protocol} was run with several numbers of presses; make some "
            f"with `tactibench run {protocol} --presses N`."
        )
    subject = f"{protocol}, {section.title.lower()}"
    terminal = Terminal()
    _say_subject(terminal, "", subject)
    print_table(terminal.out, curve_steps_table(learning, error))
    if out is not None:
        from tactibench.report.plots.curve import curve_figure

        _save(terminal, curve_figure(learning, error, measured_on=subject), out)
    save_json(json_file, curve_rows(learning, error))


def _new_sensor_curve(
    protocol: str,
    board_folder: Path,
    runs: Path | None,
    sensor: str | None,
    out: Path | None,
    json_file: Path | None,
) -> None:
    from tactibench.board.curve import new_sensor_curves
    from tactibench.board.ranking import ranking_error
    from tactibench.board.sections import all_records
    from tactibench.cli.output import Terminal
    from tactibench.protocols.loader import load_protocol
    from tactibench.report.plot_tables import curve_rows, new_sensor_table
    from tactibench.report.writers.terminal import print_table

    error = ranking_error(protocol)
    name = sensor or load_protocol(protocol).spec.defaults.sensor
    learning = new_sensor_curves(all_records(protocol, board_folder, runs), error, name)
    if not learning:
        raise UserError(
            f"no run of {protocol} on sensor {name!r} was tested on another instance than it was "
            f"trained on; make some with `tactibench run {protocol} --test sensor.instance=1`."
        )
    subject = f"{protocol}, simulated sensor {name}, instances that no training saw"
    terminal = Terminal()
    _say_subject(terminal, "", subject)
    print_table(terminal.out, new_sensor_table(learning, error))
    if out is not None:
        from tactibench.report.plots.curve import NEW_SENSOR, curve_figure

        _save(terminal, curve_figure(learning, error, NEW_SENSOR, measured_on=subject), out)
    save_json(json_file, curve_rows(learning, error))


@plot.command()
@click.argument("protocol", default="stability")
@board_options
@picture_file("--cases", "Draw one frame of every case, from a run of --store.")
@click.option("--rows", multiple=True, metavar="LABEL", help="Only these rows, in this order.")
def stability(
    protocol: str,
    out: Path | None,
    board_folder: Path,
    runs: Path | None,
    sensor: str | None,
    json_file: Path | None,
    cases: Path | None,
    rows: tuple[str, ...],
) -> None:
    """Show where the error of every model doubles on the graded hard cases of PROTOCOL.

    From the committed records, and the complete runs of --store. Seeds are pooled.

    \b
    tactibench run stability --model superpose
    tactibench plot stability --store runs --out stability.png --cases cases.png
    """
    from tactibench.board.grouping import whole
    from tactibench.board.ranking import ordered
    from tactibench.board.sections import gather_records
    from tactibench.cli.output import Terminal
    from tactibench.protocols.loader import load_protocol
    from tactibench.report.hard_cases import doubling_table
    from tactibench.report.plot_tables import stability_rows
    from tactibench.report.writers.terminal import print_table

    axes = load_protocol(protocol).spec.axes
    if not axes:
        raise UserError(f"{protocol} has no families of hard cases; take stability.")
    section = _section(whole(gather_records(protocol, board_folder, runs)), sensor, protocol)
    chosen = _rows_named(ordered(protocol, section.rows), rows)
    subject = f"{protocol}, {section.title.lower()}"
    terminal = Terminal()
    _say_subject(terminal, "", subject)
    print_table(terminal.out, doubling_table(chosen, axes))
    if out is not None:
        from tactibench.report.plots.stability import stability_figure

        _save(terminal, stability_figure(chosen, axes, measured_on=subject), out)
    if cases is not None:
        _save(terminal, _case_frames(protocol, runs, axes), cases)
    save_json(json_file, stability_rows(chosen, axes))


def _rows_named(rows: Sequence[Row], labels: tuple[str, ...]) -> list[Row]:
    by_label = {row.label: row for row in rows}
    for label in labels:
        if label not in by_label:
            raise UserError(f"no row is called {label!r}; {did_you_mean(label, by_label)}")
    return [by_label[label] for label in labels] if labels else list(rows)


def _case_frames(protocol: str, runs: Path | None, axes: Sequence[Axis]) -> Figure:
    """Draw the frames that the newest complete run has stored."""
    from tactibench.records.store import stored_runs
    from tactibench.report.plots.stability import case_frames_figure

    complete = [
        run
        for run in ([] if runs is None else stored_runs(runs))
        if run.record.protocol.id == protocol and not run.record.partial
    ]
    if not complete:
        raise UserError(
            "--cases draws the frames that a run has stored; name a store with a complete run of "
            f"{protocol} with --store."
        )
    run = max(complete, key=lambda run: run.record.created)
    examples, groups = run.arrays("examples"), run.arrays("truth")["group"]
    frames = {
        str(groups[row]): image
        for row, image in zip(examples["index"], examples["images"], strict=True)
    }
    return case_frames_figure(frames, axes, title="Hard cases: the first frame of each")


plot.add_command(limit)


def _section(records: Sequence[Record], sensor: str | None, protocol: str) -> Section:
    from tactibench.board.sections import select_section

    return select_section(records, sensor, protocol)


def _say_subject(terminal: Terminal, title: str, subject: str) -> None:
    from rich.text import Text

    if title:
        terminal.out.print(Text(title, style="bold"))
    terminal.out.print(Text(subject, style="cyan"), soft_wrap=True)


def _save(terminal: Terminal, figure: Figure, out: Path) -> None:
    from tactibench.report.plots.style import save_png

    save_png(figure, out)
    terminal.say(f"picture: {out}")
