"""``tactibench hw collect``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from tactibench import Indenter, UserError
from tactibench_tactip.collection import collect, dry_run
from tactibench_tactip.collector import Callbacks, SessionReport
from tactibench_tactip.commands.output import (
    device_options,
    format_duration,
    is_quiet,
    json_option,
    number_option,
    open_devices,
    progress_bar,
    write_figures,
)
from tactibench_tactip.commands.plan import plan_options
from tactibench_tactip.emulators import Emulation
from tactibench_tactip.plan import describe_indenter, estimate_seconds, plan_of

INTERRUPTED = 130


@click.command("collect")
@click.argument("presses", metavar="PROTOCOL|PLAN.jsonl")
@device_options
@click.option(
    "--out",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder of the data set.",
)
@plan_options
@number_option("--speed-scale", click.FloatRange(0.01, 1), 1.0, "Slow all motion down.")
@click.option(
    "--dry-run-height",
    type=click.FloatRange(min=1),
    metavar="MM",
    help="Make all moves so high above the sensor, and keep nothing.",
)
@json_option
def command(
    presses: str,
    out: Path,
    draws: tuple[str, ...],
    count: int | None,
    seed: int | None,
    speed_scale: float,
    dry_run_height: float | None,
    json_file: Path | None,
    **device: Any,
) -> int:
    """Press what a protocol trains, validates and tests on, and keep the frames as a data set.

    The whole plan is checked before anything moves. Interrupted, stopped or killed, the same
    command goes on: nothing is made twice, and nothing that was written is lost. The first Ctrl-C
    ends after the press, the second stops the robot now and draws the tool back. Presses that need
    another indenter wait until it is mounted; where a person sits, they are asked.

    \b
    tactibench hw collect exp1 --config lab.toml --out data/exp1 --draw singles
    tactibench run exp1 --sensor recorded --data data/exp1 --model unet
    """
    with open_devices(**device) as (settings, emulation):
        plan = plan_of(presses, settings, draws=draws, count=count, seed=seed)
        slow = settings.with_speed_scale(speed_scale)
        if dry_run_height is not None:
            with progress_bar("dry run", len(plan)) as advance:
                total = dry_run(slow, plan.presses, dry_run_height, advance)
            left = len(plan) - total
            click.echo(
                f"{total:,} presses were moved through {dry_run_height:g} mm above the sensor; "
                f"nothing was kept{f'; {left:,} presses are left' if left else ''}"
            )
            rows = [("presses", "made", total, ""), ("presses", "left", left, "")]
            write_figures(json_file, rows)
            return INTERRUPTED if left else 0
        if not is_quiet():
            time = format_duration(estimate_seconds(plan.presses, slow))
            line = f"{len(plan):,} presses of {presses}, about {time} of a robot's time"
            click.echo(line, err=True)
        with progress_bar("press", len(plan)) as advance:
            callbacks = Callbacks(
                notify=lambda text: click.echo(text, err=True),
                advance=advance,
                mount=lambda indenter, needed: _mount(emulation, indenter, needed),
            )

            def watch_envelope(_: object) -> None:
                # A stage comes in from its switches first, which lie outside.
                if emulation is not None:
                    emulation.keep_to(settings.envelope)

            report = collect(
                settings,
                plan,
                out,
                callbacks=callbacks,
                on_station=watch_envelope,
                speed_scale=speed_scale,
                emulated=emulation is not None,
            )
    figures = [
        ("samples", "ok", report.ok, ""),
        ("samples", "bad", report.bad, ""),
        ("presses", "left", report.left, ""),
        ("protective_stops", "all", report.stops, ""),
        *(("first_touch", str(k), touch.z0_mm, "mm") for k, touch in enumerate(report.touches)),
    ]
    write_figures(json_file, figures)
    return _print_report(report, out)


def _mount(emulation: Emulation | None, indenter: Indenter, count: int) -> bool:
    if emulation is not None:
        emulation.mount(indenter)
        return True
    if not sys.stdin.isatty():
        return False
    needed = describe_indenter(indenter)
    click.echo(f"\n{count:,} presses need {needed}. The tool stands high.", err=True)
    return click.confirm("Is it mounted, and is the way clear", default=False, err=True)


def _print_report(report: SessionReport, out: Path) -> int:
    rows = f"{report.ok:,} good and {report.bad:,} bad samples written to {out}"
    if report.interrupted:
        click.echo(f"{rows}; {report.left:,} presses are left, the same command makes them")
        return INTERRUPTED
    if report.left:
        raise UserError(
            f"{rows}; {report.left:,} presses need another indenter: mount it, correct [indenter] "
            "and run the same command."
        )
    click.echo(f"{rows}; the data set is complete")
    return 0
