"""``tactibench hw collect``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tactibench_tactip.commands.common import bar, config_options, devices, hours, json_option

if TYPE_CHECKING:
    from tactibench import Indenter
    from tactibench_tactip.collecting.collector import Report
    from tactibench_tactip.rehearsal import Rehearsed
    from tactibench_tactip.settings import Settings
    from tactibench_tactip.station import Station

INTERRUPTED = 130


@click.command("collect")
@click.argument("presses", metavar="PROTOCOL|PLAN.jsonl")
@config_options
@click.option(
    "--out",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder of the data set.",
)
@click.option("--draw", "draws", multiple=True, help="Of the protocol only these; repeat it.")
@click.option(
    "--count",
    type=click.IntRange(min=1),
    help="At most so many of every indenter of every draw, evenly spread.",
)
@click.option("--seed", type=click.IntRange(min=0), help="Other presses than the protocol's.")
@click.option(
    "--speed-scale",
    type=click.FloatRange(0.01, 1),
    default=1.0,
    show_default=True,
    help="Slow all motion down.",
)
@click.option(
    "--dry-run-height",
    type=click.FloatRange(min=1),
    metavar="MM",
    help="Make all moves so high above the sensor, and keep nothing.",
)
@json_option
def command(
    presses: str,
    config: Path,
    emulate: bool,
    time_scale: float,
    out: Path,
    draws: tuple[str, ...],
    count: int | None,
    seed: int | None,
    speed_scale: float,
    dry_run_height: float | None,
    json_file: Path | None,
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
    from tactibench_tactip.collecting.collect import collect
    from tactibench_tactip.collecting.plan import estimate_s, plan_of

    with devices(config, emulate, time_scale) as (settings, rehearsed):
        plan = plan_of(presses, settings, draws=draws, count=count, seed=seed)
        slow = settings.slowed(speed_scale)
        if dry_run_height is not None:
            return _dry_run(slow, plan.presses, dry_run_height)
        left = hours(estimate_s(plan.presses, slow))
        click.echo(f"{len(plan):,} presses of {presses}, about {left} of a robot's time", err=True)
        with bar("press", len(plan)) as advance:
            report = collect(
                settings,
                plan,
                out,
                advance=advance,
                told=lambda text: click.echo(text, err=True),
                mount=lambda indenter, n: _mount(rehearsed, indenter, n),
                entered=lambda station: _entered(rehearsed, settings, station),
                speed_scale=speed_scale,
            )
    _write(json_file, report)
    return _told(report, out)


def _entered(rehearsed: Rehearsed | None, settings: Settings, _station: Station) -> None:
    """From now on an emulator notes every motion outside the envelope."""
    if rehearsed is not None:
        from tactibench_tactip.rehearsal import envelope_of

        rehearsed.world.keep_to(envelope_of(settings.envelope))


def _mount(rehearsed: Rehearsed | None, indenter: Indenter, count: int) -> bool:
    from tactibench_tactip.collecting.plan import words

    if rehearsed is not None:
        rehearsed.world.mount(indenter)
        return True
    if not sys.stdin.isatty():
        return False
    click.echo(f"\n{count:,} presses need {words(indenter)}. The tool stands high.", err=True)
    return click.confirm("Is it mounted, and is the way clear", default=False, err=True)


def _dry_run(settings: Settings, presses: tuple, height: float) -> int:  # type: ignore[type-arg]
    from tactibench_tactip.collecting.dry_run import dry_run

    with bar("dry run", len(presses)) as advance:
        made = dry_run(settings, presses, height, advance)
    click.echo(
        f"{made:,} presses were moved through {height:g} mm above the sensor; nothing was kept"
    )
    return 0


def _told(report: Report, out: Path) -> int:
    from tactibench import UserError

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


def _write(json_file: Path | None, report: Report) -> None:
    from tactibench_tactip.commands.common import write_figures

    write_figures(
        json_file,
        [
            ("samples", "ok", report.ok, ""),
            ("samples", "bad", report.bad, ""),
            ("presses", "left", report.left, ""),
            ("protective_stops", "all", report.stops, ""),
            *(("first_touch", str(k), touch.z0_mm, "mm") for k, touch in enumerate(report.touches)),
        ],
    )
