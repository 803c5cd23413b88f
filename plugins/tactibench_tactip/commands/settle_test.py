"""``tactibench hw settle-test``."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench_tactip.commands.output import (
    device_options,
    devices,
    json_option,
    print_rows,
    write_figures,
)
from tactibench_tactip.plan import check_scenes
from tactibench_tactip.settling import draw_settling, held_press, measure_settling
from tactibench_tactip.station import Station
from tactibench_tactip.touch import find_touch

TIMES_S = (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)


@click.command("settle-test")
@device_options
@click.option(
    "--depth", type=click.FloatRange(0.5, 6.0), default=3.0, show_default=True, help="mm."
)
@click.option(
    "--seconds",
    type=click.FloatRange(0.5, 30),
    default=3.0,
    show_default=True,
    help="How long the press is held.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.png",
    help="Draw the change against time.",
)
@json_option
def command(
    config: Path,
    emulate: bool,
    time_scale: float,
    depth: float,
    seconds: float,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """Hold a press and see how long its image still changes.

    Skin and gel creep after a press. timing.settle_s is well chosen when what still changes after
    it is less than the noise of a frame.
    """
    with devices(config, emulate, time_scale) as (settings, _):
        station = Station(settings)
        scenes = [held_press(settings, depth)]
        turns = station.robot.turns
        check_scenes("the test", scenes, settings, station.geometry, turns=turns)
        with station:
            station.look_at_rest()
            find_touch(station, first=True)
            settling = measure_settling(station, depth, seconds)
    times = [t for t in TIMES_S if t <= seconds]
    rows = [(f"{t:.2f}", f"{settling.change_at(t):.3f}") for t in times]
    print_rows(("s after the move", "change to the end, grey levels"), rows)
    click.echo(
        f"the image is still within noise ({settling.noise:.3f}) after {settling.settled_s:.2f} s; "
        f"timing.settle_s is {settings.timing.settle_s:g}"
    )
    if emulate:
        click.echo("emulated: a simulated skin does not creep, the figures show noise alone")
    if out is not None:
        draw_settling(out, settling, depth)
        click.echo(f"picture: {out}")
    figures = [
        ("settled", "all", settling.settled_s, "s"),
        ("noise", "all", settling.noise, "grey levels"),
    ]
    write_figures(json_file, figures)
