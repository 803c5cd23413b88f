"""``tactibench hw plan`` and ``tactibench hw collect``."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from tactibench import Indenter, UserError
from tactibench.report import duration
from tactibench_tactip.collection import Callbacks, SessionReport, dry_run
from tactibench_tactip.collection import collect as collect_presses
from tactibench_tactip.commands.output import (
    Verb,
    config_option,
    device_options,
    is_quiet,
    number_option,
    open_devices,
    print_rows,
    progress_bar,
)
from tactibench_tactip.geometry import geometry_of
from tactibench_tactip.plan import (
    by_indenter,
    check_plan,
    describe_indenter,
    estimate_seconds,
    is_mounted,
    plan_of,
)
from tactibench_tactip.robots import StopNowError, make_robot
from tactibench_tactip.settings import read_settings

INTERRUPTED = 130
MOUNT_S = 180.0
"""Time in which a person mounts an indenter and finds its middle (assumed)."""
MOST_ROWS = 20


def plan_options(verb: Verb) -> Verb:
    """Add the options that choose presses of a protocol, as ``plan_of`` takes them."""
    draw = click.option(
        "--draw",
        "draws",
        multiple=True,
        metavar="NAME[=N]",
        help="Of the protocol only these, or N of every indenter of it; repeat it.",
    )
    count = click.option(
        "--count",
        type=click.IntRange(min=1),
        help="At most so many of every indenter of every draw, evenly spread.",
    )
    seed = click.option(
        "--seed", type=click.IntRange(min=0), help="Other presses than the protocol's."
    )
    return draw(count(seed(verb)))


@click.command("plan")
@click.argument("presses", metavar="PROTOCOL|PLAN.jsonl")
@config_option
@plan_options
def plan(presses: str, config: Path, **choice: Any) -> None:
    """Check the presses that a protocol needs against the configuration, without any device.

    Every pose of every press must lie in the envelope. Shows what has to be mounted for how many
    presses, how long it takes, and how often a hand has to mount another indenter.
    """
    settings = read_settings(config)
    planned = plan_of(presses, settings, **choice)
    check_plan(planned, settings, geometry_of(settings), turns=make_robot(settings).turns)
    rows: list[tuple[str, str, str, str]] = []
    total, hands = 0.0, 0
    for indenter, group in by_indenter(planned.presses).items():
        name, seconds = describe_indenter(indenter), estimate_seconds(group, settings)
        total += seconds
        mounted = "mounted" if is_mounted(settings.indenter.indenter(), indenter) else ""
        hands += not mounted
        rows.append((name, f"{len(group):,}", duration(seconds), mounted))
    print_rows(("indenter", "presses", "time", ""), rows[:MOST_ROWS])
    if len(rows) > MOST_ROWS:
        click.echo(f"... and {len(rows) - MOST_ROWS:,} more indenters")
    time = duration(total)
    click.echo(f"{len(planned):,} presses of {presses}, all inside the envelope; about {time}")
    if hands:
        more = duration(hands * MOUNT_S)
        click.echo(f"indenters to mount by hand: {hands:,}, which takes about {more} more")


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
def collect(
    presses: str, out: Path, speed_scale: float, dry_run_height: float | None, **options: Any
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
    with open_devices(options.pop("config"), options.pop("emulate")) as settings:
        plan = plan_of(presses, settings, **options)
        slow = settings.with_speed_scale(speed_scale)
        if dry_run_height is not None:
            with progress_bar("dry run", len(plan)) as advance:
                total = dry_run(slow, plan.presses, dry_run_height, callbacks_of(advance))
            left = len(plan) - total
            click.echo(
                f"{total:,} presses were moved through {dry_run_height:g} mm above the sensor; "
                f"nothing was kept{f'; {left:,} presses are left' if left else ''}"
            )
            return INTERRUPTED if left else 0
        if not is_quiet():
            time = duration(estimate_seconds(plan.presses, slow))
            line = f"{len(plan):,} presses of {presses}, about {time} of a robot's time"
            click.echo(line, err=True)
        with progress_bar("press", len(plan)) as advance:
            report = collect_presses(
                settings, plan, out, callbacks=callbacks_of(advance), speed_scale=speed_scale
            )
    return _print_report(report, out)


def callbacks_of(advance: Callable[[int], None]) -> Callbacks:
    """Return the functions by which a session talks to the person at a terminal."""
    return Callbacks(lambda text: click.echo(text, err=True), advance, _mount)


def _mount(indenter: Indenter, count: int) -> bool:
    if not sys.stdin.isatty():
        return False
    needed = describe_indenter(indenter)
    click.echo(f"\n{count:,} presses need {needed}. The tool stands high.", err=True)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # nothing moves meanwhile
    try:
        return click.confirm("Is it mounted, and is the way clear", default=False, err=True)
    except click.Abort:  # Ctrl-C, or the end of the input
        raise StopNowError from None
    finally:
        signal.signal(signal.SIGINT, before)


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
