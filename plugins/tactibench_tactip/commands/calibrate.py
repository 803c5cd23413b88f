"""``tactibench hw calibrate``."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench import UserError
from tactibench_tactip.calibration import calibrate
from tactibench_tactip.commands.output import (
    device_options,
    devices,
    json_option,
    progress_bar,
    write_figures,
)
from tactibench_tactip.emulators import HiddenOffset
from tactibench_tactip.station import Station

HIDDEN = HiddenOffset(0.4, -0.3, 0.8, 6.0)
"""Where a rehearsal's sensor sits, for the calibration to find."""


@click.command("calibrate")
@device_options
@click.option(
    "--radius",
    type=click.FloatRange(1, 8),
    default=4.0,
    show_default=True,
    help="Of the circle of presses, mm.",
)
@click.option(
    "--depth",
    type=click.FloatRange(0.5, 5),
    default=2.0,
    show_default=True,
    help="Of the presses, mm.",
)
@click.option(
    "--points",
    type=click.IntRange(4, 24),
    default=8,
    show_default=True,
    help="Presses on the circle.",
)
@json_option
def command(
    config: Path,
    emulate: bool,
    time_scale: float,
    radius: float,
    depth: float,
    points: int,
    json_file: Path | None,
) -> None:
    """Find where the sensor sits, from presses of one tip: centre, yaw of the image, height.

    First touch is found at every place: the heights lie on the dome, whose top is the centre. The
    place of every press in the image, against where the tool was, gives the yaw. Prints the line
    for [frames].
    """
    with devices(config, emulate, time_scale, hidden=HIDDEN) as (settings, _):
        if settings.indenter.kind != "single":
            raise UserError(
                'a calibration needs one tip; mount it and say indenter.kind = "single".'
            )
        with Station(settings) as station, progress_bar("press", points + 1) as advance:
            result = calibrate(station, radius, depth, points, advance)
    x, y, yaw = result.sensor
    click.echo(f"sensor = [{x:.3f}, {y:.3f}, {yaw:.2f}]    # in [frames]")
    click.echo(
        f"one sigma {result.centre_std_mm:.3f} mm and {result.yaw_std_deg:.2f} deg from "
        f"{points + 1} presses; heights lie {result.height_rms_mm:.3f} mm from the dome; first "
        f"touch at z {result.z0_mm:+.3f} mm of the work frame"
    )
    if emulate:
        click.echo(
            f"emulated: the sensor sits at {HIDDEN.x}, {HIDDEN.y} mm and {HIDDEN.yaw:g} deg from "
            "[frames]"
        )
    figures = [
        ("centre", "x", x, "mm"),
        ("centre", "y", y, "mm"),
        ("yaw", "all", yaw, "deg"),
        ("first_touch", "all", result.z0_mm, "mm"),
    ]
    write_figures(json_file, figures)
