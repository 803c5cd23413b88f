"""``tactibench hw plan``."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench_tactip.commands.output import (
    Verb,
    config_option,
    format_duration,
    json_option,
    picture_option,
    print_rows,
    write_figures,
)
from tactibench_tactip.plan import (
    check_plan,
    describe_indenter,
    draw_plan,
    estimate_seconds,
    is_mounted,
    plan_of,
)
from tactibench_tactip.press_geometry import geometry_of
from tactibench_tactip.robots.base import make_robot
from tactibench_tactip.settings import read_settings

MOUNT_S = 180.0
"""Time in which a person mounts an indenter and finds its middle (assumed)."""
MOST_ROWS = 20


def plan_options(verb: Verb) -> Verb:
    """Add the options that choose presses of a protocol."""
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
@picture_option("Draw where the tool goes.")
@json_option
def command(
    presses: str,
    config: Path,
    draws: tuple[str, ...],
    count: int | None,
    seed: int | None,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """Check the presses that a protocol needs against the configuration, without any device.

    Every pose of every press must lie in the envelope. Shows what has to be mounted for how many
    presses, how long it takes, and how often a hand has to mount another indenter.
    """
    settings = read_settings(config)
    plan = plan_of(presses, settings, draws=draws, count=count, seed=seed)
    geometry = geometry_of(settings)
    check_plan(plan, settings, geometry, turns=make_robot(settings).turns)
    rows: list[tuple[str, str, str, str]] = []
    figures: list[tuple[str, str, float, str]] = []
    total, hands = 0.0, 0
    for indenter, group in plan.mounts():
        name, seconds = describe_indenter(indenter), estimate_seconds(group, settings)
        total += seconds
        mounted = "mounted" if is_mounted(settings.indenter, indenter) else ""
        hands += not mounted
        rows.append((name, f"{len(group):,}", format_duration(seconds), mounted))
        figures += [("presses", name, len(group), ""), ("time", name, seconds, "s")]
    print_rows(("indenter", "presses", "time", ""), rows[:MOST_ROWS])
    if len(rows) > MOST_ROWS:
        click.echo(f"... and {len(rows) - MOST_ROWS:,} more indenters")
    time = format_duration(total)
    click.echo(f"{len(plan):,} presses of {presses}, all inside the envelope; about {time}")
    if hands:
        times = f"{hands:,} time{'s' if hands > 1 else ''}"
        changes, each = format_duration(hands * MOUNT_S), format_duration(MOUNT_S)
        click.echo(f"a hand mounts an indenter {times}: about {changes} more, {each} each")
    figures += [("time", "all", total, "s"), ("mounts by hand", "all", hands, "")]
    if out is not None:
        draw_plan(out, plan, settings, geometry)
        click.echo(f"picture: {out}")
    write_figures(json_file, figures)
