"""``tactibench plot limit``: the smallest errors that a sensor's noise allows."""

from __future__ import annotations

import math
from pathlib import Path

import click

from tactibench.cli.options import json_option, param_option, picture_option, save_json
from tactibench.errors import UserError


def _depths(_ctx: click.Context, _option: click.Parameter, text: str) -> tuple[float, ...]:
    """Read "1,3,6" as (1.0, 3.0, 6.0)."""
    try:
        numbers = tuple(float(number) for number in text.split(","))
    except ValueError:
        raise click.BadParameter(f"{text!r} is no list of numbers such as 1,3,6.") from None
    if not all(number > 0 and math.isfinite(number) for number in numbers):
        raise click.BadParameter(f"{text!r} holds a number that is not above 0.")
    return numbers


@click.command(short_help="the Cramer-Rao bound over the workspace of a sensor")
@click.option("--sensor", "sensor_name", default="tactip-127", show_default=True, help="Preset.")
@param_option("sensor.NAME=VALUE", "Set one.")
@click.option("--scene", type=click.Choice(["single", "dual"]), default="single", show_default=True)
@click.option(
    "--depth",
    "depths",
    callback=_depths,
    metavar="MM,...",
    default="1,3,6",
    show_default=True,
    help="Depths of the press, mm.",
)
@click.option("--spacing", type=click.FloatRange(0.1, 40), help="Of the two tips, mm; default 7.")
@click.option("--yaw", type=click.FloatRange(-360, 360), help="Of the two tips, deg; default 0.")
@click.option(
    "--radius",
    type=click.FloatRange(0.1, 20),
    default=3.0,
    show_default=True,
    help="Of the tips, mm.",
)
@click.option(
    "--range",
    "reach",
    type=click.FloatRange(0, 20),
    default=6.4,
    show_default=True,
    help="Half side of the workspace, mm.",
)
@click.option(
    "--step",
    type=click.FloatRange(0.05, 20),
    default=0.8,
    show_default=True,
    help="Between the presses, mm.",
)
@click.option(
    "--nuisance",
    "nuisances",
    default="",
    metavar="NAME,...",
    help="Unknown properties of the camera, or all.",
)
@picture_option
@json_option
def limit(
    sensor_name: str,
    params: tuple[str, ...],
    scene: str,
    depths: tuple[float, ...],
    spacing: float | None,
    yaw: float | None,
    radius: float,
    reach: float,
    step: float,
    nuisances: str,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """Show the Cramer-Rao bound on contacts over the workspace of a simulated sensor.

    No unbiased estimator has a smaller standard deviation on these frames: x, y and depth of all
    contacts are unknown together, and so is every --nuisance. The separation is that of two tips in
    the plane. For two tips a second table shows the smallest spacing at which they differ from one.

    \b
    tactibench plot limit --scene dual --spacing 6.5 --out map.png
    tactibench plot limit --scene dual --radius 1 --spacing 2 --depth 0.5,1,1.5
    tactibench plot limit --param sensor.size=256 --nuisance brightness,background,shift,roll
    """
    from tactibench.cli.output import Terminal
    from tactibench.report.limit_data import LimitOptions, limit_data, limit_plan
    from tactibench.report.plot_tables import (
        limit_remarks,
        limit_table,
        spacing_remarks,
        spacing_table,
    )
    from tactibench.report.writers.terminal import print_table

    options = LimitOptions(
        sensor_name,
        _parameters(params),
        scene,
        depths,
        spacing,
        yaw,
        radius,
        reach,
        step,
        tuple(name.strip() for name in nuisances.split(",") if name.strip()),
    )
    plan = limit_plan(options)
    terminal = Terminal()
    with terminal.task("Cramer-Rao bounds", plan.request.presses) as advance:
        data = limit_data(plan, advance)
    maps = data.maps
    terminal.say(data.subject)
    print_table(terminal.out, limit_table(maps))
    for remark in limit_remarks(maps):
        terminal.say(remark)
    if maps.spacings is not None:
        terminal.say("")
        print_table(terminal.out, spacing_table(maps))
        for remark in spacing_remarks(maps):
            terminal.say(remark)
    if out is not None:
        from tactibench.report.plots.style import save_png

        save_png(data.draw(), out)
        terminal.say(f"picture: {out}")
    save_json(json_file, dict(data.document))


def _parameters(params: tuple[str, ...]) -> dict[str, str]:
    from tactibench.run.request import read_parameters

    given = read_parameters(params)
    for kind in set(given) - {"sensor"}:
        raise UserError(f"only the sensor has parameters here, --param names {kind}; leave it out.")
    return given.get("sensor", {})
