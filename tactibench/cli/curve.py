"""``tactibench plot curve``: error against training presses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import (
    board_option,
    json_option,
    more_runs_option,
    one_sensor_option,
    picture_option,
)
from tactibench.errors import UserError

if TYPE_CHECKING:
    from rich.console import Console

    from tactibench.board.curve import Curve
    from tactibench.board.ranking import RankingError


@click.command()
@click.argument("protocol")
@picture_option
@board_option
@more_runs_option
@one_sensor_option
@json_option
def curve(
    protocol: str,
    out: Path | None,
    board_folder: Path,
    runs: Path | None,
    sensor: str | None,
    json_file: Path | None,
) -> None:
    """Show the learning curves of PROTOCOL: the error that orders its board against presses.

    From runs with `--presses N` and the whole run of the same configuration.

    \b
    tactibench run exp1 --model unet --presses 250
    tactibench plot curve exp1 --store runs --out curve.png
    """
    from tactibench.board.choose import gathered, of_sensor
    from tactibench.board.curve import curves
    from tactibench.board.ranking import ranking_error
    from tactibench.cli.output import Terminal
    from tactibench.records.files import write_json

    records = gathered(protocol, board_folder, runs)
    error = ranking_error(protocol)
    section = of_sensor(records, sensor, protocol)
    found = curves(section.rows, error)
    if not found:
        raise UserError(
            f"no configuration of {protocol} was run with several numbers of presses; make some "
            f"with `tactibench run {protocol} --presses N`."
        )
    subject = f"{protocol}, {section.title.lower()}"
    terminal = Terminal()
    _print(terminal.out, found, error, subject)
    if out is not None:
        from tactibench.board.figures.curve import learning_curves

        learning_curves(
            out,
            found,
            error=f"{error.name}, {error.unit}",
            title="Learning curve; bars: 95 % over presses, mean of the seeds",
            measured_on=subject,
        )
        terminal.say(f"picture: {out}")
    if json_file is not None:
        write_json(json_file, _json(found, error))


def _print(console: Console, found: Sequence[Curve], error: RankingError, subject: str) -> None:
    from rich.text import Text

    from tactibench.board.numbers import number
    from tactibench.cli.report.cells import aligned, print_grid

    steps = [(curve, step) for curve in found for step in curve.steps]
    pooled = [step.error for _, step in steps]
    values = aligned(
        [
            "n/a"
            if p is None
            else f"{number(p.value, error.decimals)} [{_end(p.low, error)}, {_end(p.high, error)}]"
            for p in pooled
        ]
    )
    spreads = ["n/a" if p is None or p.sd is None else number(p.sd, error.decimals) for p in pooled]
    rows, last = [], ""
    for (curve, step), value, sd in zip(steps, values, spreads, strict=True):
        name = "" if curve.label == last else curve.label
        rows.append((name, f"{step.presses:,}", value, sd, str(step.seeds)))
        last = curve.label
    console.print(Text(f"{error.name} by training presses: value [95 % interval]", style="bold"))
    console.print(Text(subject, style="cyan"), soft_wrap=True)
    heads = ("", "presses", f"error, {error.unit}", "sd of seeds", "seeds")
    print_grid(console, heads, rows, right=frozenset({"presses", "sd of seeds", "seeds"}))


def _end(end: float | None, error: RankingError) -> str:
    from tactibench.board.numbers import number

    return "open" if end is None else number(end, error.decimals)


def _json(found: Sequence[Curve], error: RankingError) -> list[dict[str, Any]]:
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
        for curve in found
        for step in curve.steps
    ]
