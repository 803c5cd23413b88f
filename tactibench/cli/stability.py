"""``tactibench plot stability``: where models start to fail."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import (
    board_option,
    json_option,
    more_runs_option,
    one_sensor_option,
    picture,
    picture_option,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from tactibench.board.hard_cases import Graded
    from tactibench.board.rows import Row
    from tactibench.protocols.families import Axis

PROTOCOL = "stability"
WITH_INTERVALS = 2
"""Intervals of more rows than these would not fit beside each other."""


@click.command()
@picture_option
@click.option(
    "--cases",
    type=click.Path(path_type=Path, dir_okay=False, writable=True),
    callback=picture,
    metavar="FILE.png",
    help="Draw one frame of every case, from a run of --runs.",
)
@click.option("--rows", multiple=True, metavar="LABEL", help="Only these rows, in this order.")
@board_option
@more_runs_option
@one_sensor_option
@json_option
def stability(
    out: Path | None,
    cases: Path | None,
    rows: tuple[str, ...],
    board_folder: Path,
    runs: Path | None,
    sensor: str | None,
    json_file: Path | None,
) -> None:
    """Show where the error of every model doubles on the graded cases of protocol stability.

    From the committed records, and the complete runs of --runs. Seeds are pooled.

    \b
    tactibench run stability --model superpose
    tactibench plot stability --store runs --out stability.png --cases cases.png
    """
    from tactibench.board.choose import gathered, of_sensor
    from tactibench.board.hard_cases import graded
    from tactibench.board.labels import whole
    from tactibench.board.ranking import ordered
    from tactibench.cli.output import Terminal
    from tactibench.protocols.loader import load_protocol
    from tactibench.records.files import write_json

    axes = load_protocol(PROTOCOL).keys.axes
    section = of_sensor(whole(gathered(PROTOCOL, board_folder, runs)), sensor, PROTOCOL)
    chosen = _chosen(ordered(PROTOCOL, section.rows), rows)
    series = [(row.label, graded(row, axes)) for row in chosen]
    subject = f"{PROTOCOL}, {section.title.lower()}"
    terminal = Terminal()
    _print(terminal.out, axes, series, subject)
    if out is not None:
        from tactibench.board.figures.hard_cases import hard_cases

        hard_cases(
            out, series, title="Hard cases: error from the easy case on", measured_on=subject
        )
        terminal.say(f"picture: {out}")
    if cases is not None:
        _draw_cases(cases, runs, axes)
        terminal.say(f"picture: {cases}")
    if json_file is not None:
        write_json(json_file, _json(series))


def _chosen(rows: Sequence[Row], labels: tuple[str, ...]) -> list[Row]:
    """The rows of these labels, or all. Raises UserError."""
    from tactibench.errors import UserError, did_you_mean

    by_label = {row.label: row for row in rows}
    for label in labels:
        if label not in by_label:
            raise UserError(f"no row is called {label!r}; {did_you_mean(label, by_label)}")
    return [by_label[label] for label in labels] if labels else list(rows)


def _print(
    console: Console,
    axes: Sequence[Axis],
    series: Sequence[tuple[str, Sequence[Graded]]],
    subject: str,
) -> None:
    """A table a family: rows with the easy and the hardest error and the doubling point."""
    from rich.text import Text

    from tactibench.cli.report.cells import aligned, print_grid
    from tactibench.cli.report.hard_cases import doubling

    head = "" if len(series) > WITH_INTERVALS else ": value [95 % interval]"
    console.print(Text(f"Where the error doubles{head}", style="bold"))
    console.print(Text(subject, style="cyan"), soft_wrap=True)
    lines: list[tuple[str, ...]] = []
    brief = len(series) > WITH_INTERVALS
    places = {
        label: aligned(
            [
                doubling(one.doubles).partition(" [")[0] if brief else doubling(one.doubles)
                for one in families
            ]
        )
        for label, families in series
    }
    for k, axis in enumerate(axes):
        if axis.ordered:
            name = f"{axis.family}, {axis.unit}" if axis.unit else axis.family
            cells = (places[label][k] for label, _ in series)
            lines.append((name, f"{axis.easy:g} to {axis.values[-1]:g}", *cells))
    heads = ("family", "easy to hardest", *(label for label, _ in series))
    print_grid(console, heads, lines)


def _draw_cases(path: Path, runs: Path | None, axes: Sequence[Axis]) -> None:
    """Raises UserError where no run has stored frames."""
    from tactibench.board.figures.case_frames import case_frames
    from tactibench.errors import UserError
    from tactibench.records.store import stored_runs

    stored = [] if runs is None else list(stored_runs(runs))
    found = [one for one in stored if one.record.protocol.id == PROTOCOL and not one.record.partial]
    if not found:
        raise UserError(
            "--cases draws the frames that a run has stored; name a store with a complete run of "
            f"{PROTOCOL} with --runs."
        )
    run = max(found, key=lambda one: str(one.record.created))
    examples, groups = run.arrays("examples"), run.arrays("truth")["group"]
    frames = {
        str(groups[row]): image
        for row, image in zip(examples["index"], examples["images"], strict=True)
    }
    case_frames(path, frames, axes, title="Hard cases: the first frame of each")


def _json(series: Sequence[tuple[str, Sequence[Graded]]]) -> list[dict[str, Any]]:
    rows = []
    for label, families in series:
        for one in families:
            axis, found = one.axis, one.doubles
            if found is not None:
                rows.append(
                    {
                        "metric": "doubles_at",
                        "group": label,
                        "family": axis.family,
                        "value": found.value,
                        "low": found.low,
                        "high": found.high,
                        "censored": found.censored,
                        "unit": axis.unit,
                        "harder": axis.harder,
                    }
                )
            rows += [
                {
                    "metric": "ospa_mm",
                    "group": label,
                    "family": axis.family,
                    "at": case.value,
                    "easy": case.easy,
                    "value": case.error.value,
                    "low": case.error.low,
                    "high": case.error.high,
                    "unit": "mm",
                }
                for case in one.cases
                if case.error is not None
            ]
    return rows
