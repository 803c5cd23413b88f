"""``tactibench hw settle-test``."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench_tactip.commands.common import (
    config_options,
    devices,
    json_option,
    print_rows,
    write_figures,
)


@click.command("settle-test")
@config_options
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
    from tactibench_tactip.collecting.plan import check_scenes
    from tactibench_tactip.collecting.settling import draw_settling, held, measure_settling
    from tactibench_tactip.station import Station
    from tactibench_tactip.touch.search import find_touch

    with devices(config, emulate, time_scale) as (settings, _):
        station = Station(settings)
        turns = station.owner.robot.turns
        scenes = [held(settings, depth)]
        check_scenes("the test", scenes, settings, station.geometry, turns=turns)
        with station:
            station.look_at_rest()
            find_touch(station, first=True)
            found = measure_settling(station, depth, seconds)
        scale = settings.robot.time_scale
    rows = [
        (f"{t:.2f}", f"{found.change_at(t):.3f}")
        for t in (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)
        if t <= seconds
    ]
    print_rows(("s after the move", "change to the end, grey levels"), rows)
    click.echo(
        f"the image is still within noise ({found.noise:.3f}) after {found.settled_s:.2f} s; "
        f"timing.settle_s is {settings.timing.settle_s:g}"
    )
    if scale != 1.0:
        click.echo("emulated: a simulated skin does not creep, the figures show noise alone")
    if out is not None:
        draw_settling(out, found, depth)
        click.echo(f"picture: {out}")
    write_figures(
        json_file,
        [
            ("settled", "all", found.settled_s, "s"),
            ("noise", "all", found.noise, "grey levels"),
        ],
    )
