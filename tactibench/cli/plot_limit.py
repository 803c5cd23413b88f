"""``tactibench plot limit``: the smallest errors that a sensor's noise allows."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import json_option, param_option, picture_option, save_json
from tactibench.errors import UserError, did_you_mean

if TYPE_CHECKING:
    from tactibench.plugins.base import Sensor
    from tactibench.plugins.specs import SensorSpec, Value

MOST_CELLS = 101
"""Along one side of the map: a finer one takes minutes and shows nothing more."""
SPACING_MM = 7.0


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
    from tactibench.board.limits import map_limits, rows_of
    from tactibench.cli.output import Terminal
    from tactibench.contacts import Indenter
    from tactibench.plugins.host import PluginHost
    from tactibench.report.plot_tables import (
        limit_remarks,
        limit_table,
        spacing_remarks,
        spacing_table,
    )
    from tactibench.report.writers.terminal import print_table

    if scene == "single" and (spacing is not None or yaw is not None):
        raise UserError("--spacing and --yaw belong to two tips; add --scene dual.")
    spec = PluginHost().sensors[sensor_name]
    values = _settings(spec, params)
    sensor = _sensor(spec, values)
    apart = spacing or SPACING_MM
    indenter = Indenter.single(radius) if scene == "single" else Indenter.dual(apart, radius)
    request = _request(indenter, reach, step, depths, yaw or 0.0, _nuisances(sensor, nuisances))
    terminal = Terminal()
    with terminal.task("Cramer-Rao bounds", request.presses) as advance:
        maps = map_limits(sensor, request, advance)
    subject = f"{spec.origin} sensor {_label(spec, values)}, {_description(request)}"
    terminal.say(subject)
    print_table(terminal.out, limit_table(maps))
    for remark in limit_remarks(maps):
        terminal.say(remark)
    if maps.spacings is not None:
        terminal.say("")
        print_table(terminal.out, spacing_table(maps))
        for remark in spacing_remarks(maps):
            terminal.say(remark)
    if out is not None:
        from tactibench.report.plots.limit import limit_figure
        from tactibench.report.plots.style import save_png

        save_png(limit_figure(maps, measured_on=subject), out)
        terminal.say(f"picture: {out}")
    identity = {"name": spec.name, "origin": spec.origin, "parameters": dict(values)}
    save_json(
        json_file,
        {
            "sensor": {**identity, "description": sensor.describe()},
            **_json(request),
            "metrics": rows_of(maps),
            "maps_mm": _cells(maps),
            **_spacings(maps),
        },
    )


def _settings(spec: SensorSpec, params: tuple[str, ...]) -> dict[str, Value]:
    from tactibench.run.request import read_parameters

    given = read_parameters(params)
    for kind in set(given) - {"sensor"}:
        raise UserError(f"only the sensor has parameters here, --param names {kind}; leave it out.")
    return spec.settings(given.get("sensor", {}))


def _sensor(spec: SensorSpec, values: dict[str, Value]) -> Sensor:
    """Build the sensor. Raises UserError for one that knows no bound."""
    import numpy as np

    from tactibench.contacts import Indenter, Pose, Scene
    from tactibench.plugins.base import SensorContext

    if not spec.needs_data:
        sensor = spec.load()(SensorContext(np.random.SeedSequence(0)), **values)
        if sensor.covariance(Scene(Indenter.single(), Pose(depth=1.0))) is not None:
            return sensor
    raise UserError(
        f"sensor {spec.name!r} does not know what limits its frames; take a simulated sensor, "
        "for example tactip-127."
    )


def _nuisances(sensor: Sensor, text: str) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if names == ("all",):
        return tuple(sensor.nuisances)
    for name in names:
        if name not in sensor.nuisances:
            raise UserError(f"unknown nuisance {name!r}; {did_you_mean(name, sensor.nuisances)}")
    return names


def _request(
    indenter: Any,
    reach: float,
    step: float,
    depths: tuple[float, ...],
    yaw: float,
    nuisances: tuple[str, ...],
) -> Any:
    from tactibench.board.limits import LimitRequest
    from tactibench.contacts import Grid

    half = math.floor(reach / step + 1e-9)
    cells = 2 * half + 1  # a press at the apex, and whole steps from there
    if cells > MOST_CELLS:
        raise UserError(
            f"--step {step:g} mm makes {cells} presses along +-{reach:g} mm; at most {MOST_CELLS} "
            "are taken, so take larger steps or a smaller --range."
        )
    return LimitRequest(indenter, Grid.centred(cells, step), depths, yaw, nuisances)


def _label(spec: SensorSpec, values: dict[str, Value]) -> str:
    defaults = spec.defaults(values)
    other = [f"{name}={value}" for name, value in values.items() if value != defaults[name]]
    return f"{spec.name}({','.join(other)})" if other else spec.name


def _description(request: Any) -> str:
    edge = abs(request.grid.origin[0])
    tips = request.indenter.name
    if tips == "dual":
        spacing = request.indenter.offsets[1][0] - request.indenter.offsets[0][0]
        tips += f" {spacing:g} mm apart, yaw {request.yaw:g} deg"
    tips += f", R {request.indenter.radius:g} mm"
    names = request.nuisances
    unknown = " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:]))) or "nothing"
    return (
        f"{tips}, x, y within ±{edge:g} mm by {request.grid.pitch:g} mm; unknown besides "
        f"the contacts: {unknown}"
    )


def _json(request: Any) -> dict[str, Any]:
    x, y = request.grid.axes()
    return {
        "scene": {
            "indenter": request.indenter.name,
            "radius_mm": request.indenter.radius,
            "offsets_mm": request.indenter.offsets,
            "yaw_deg": request.yaw,
        },
        "workspace": {
            "x_mm": [round(v, 9) for v in x.tolist()],
            "y_mm": [round(v, 9) for v in y.tolist()],
            "depth_mm": list(request.depths),
        },
        "nuisances": list(request.nuisances),
    }


def _cells(maps: Any) -> dict[str, Any]:
    """Return quantity -> [depth][row][column], mm."""
    return {
        quantity: _nested(maps.values[:, q]) for q, quantity in enumerate(maps.request.quantities)
    }


def _spacings(maps: Any) -> dict[str, Any]:
    """Return the spacings from which two tips differ from one, with their places; {}: none."""
    if maps.spacings is None:
        return {}
    x, y = (axis.round(9).tolist() for axis in maps.request.coarse.axes())
    return {"two_from_one": {"x_mm": x, "y_mm": y, "spacing_mm": _nested(maps.spacings)}}


def _nested(layers: Any) -> list[Any]:
    """Return [depth][row][column]; "inf" without a bound, null for a refused press."""

    def cell(value: float) -> float | str | None:
        return "inf" if math.isinf(value) else None if math.isnan(value) else value

    return [[[cell(v) for v in row] for row in layer] for layer in layers.tolist()]
