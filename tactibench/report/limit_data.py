"""The smallest errors that a sensor's noise allows, as a figure with its numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tactibench.board import LimitMaps, LimitRequest, map_limits
from tactibench.board.limits import rows_of
from tactibench.contacts import Grid, Indenter, Pose, Scene
from tactibench.errors import UserError, did_you_mean
from tactibench.plugins import PluginHost, Sensor, SensorContext, SensorSpec, Value
from tactibench.report.plot_data import PlotData
from tactibench.report.plot_tables import (
    limit_remarks,
    limit_table,
    spacing_remarks,
    spacing_table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactibench.run import Reporter

MOST_CELLS = 101
"""Most cells along one side of the map: a finer map takes minutes and shows nothing more."""
SPACING_MM = 7.0
"""Spacing of two tips where none is given."""


def limit_data(
    name: str,
    params: Mapping[str, str],
    *,
    scene: str,
    depths: Sequence[float],
    spacing: float | None,
    yaw: float | None,
    radius: float,
    reach: float,
    step: float,
    nuisances: Sequence[str],
    reporter: Reporter,
) -> PlotData:
    """Return the limits of a sensor over its workspace.

    Args:
        name: Name of a simulated sensor.
        params: Parameters of the sensor that are not at their defaults.
        scene: "single" or "dual".
        depths: Depths of the presses, mm.
        spacing: Spacing of two tips, mm; None: 7.
        yaw: Yaw of two tips, deg; None: 0.
        radius: Radius of the tips, mm.
        reach: Half side of the workspace, mm.
        step: Step between the presses, mm.
        nuisances: Unknown properties of the camera; ("all",) for all.
        reporter: Shows progress.

    Raises:
        UserError: Something does not exist or does not fit, or the sensor refuses all presses.
    """
    if scene not in ("single", "dual"):
        raise UserError(f"there is no scene {scene!r}; take 'single' or 'dual'.")
    if scene == "single" and (spacing is not None or yaw is not None):
        raise UserError("--spacing and --yaw belong to two tips; add --scene dual.")
    distance, turn = SPACING_MM if spacing is None else spacing, yaw or 0.0
    depths = tuple(map(float, depths))
    if not depths:
        raise UserError("there is no depth to press to; name one or more, such as 1, 3, 6.")
    lengths = [("radius", radius), ("spacing", distance), ("step", step)]
    for quantity, value in [*lengths, *(("depth", depth) for depth in depths)]:
        if not (value > 0 and math.isfinite(value)):
            raise UserError(f"{quantity} {value:g} mm is not above 0; take a positive number.")
    if not (reach >= 0 and math.isfinite(reach) and math.isfinite(turn)):
        raise UserError("the range must not be below 0 mm, and the yaw must be finite.")
    spec = PluginHost().sensors[name]
    settings = spec.settings(dict(params))
    sensor = _sensor(spec, settings)
    indenter = Indenter.single(radius) if scene == "single" else Indenter.dual(distance, radius)
    unknown, grid = _nuisances(sensor, nuisances), _grid(reach, step)
    request = LimitRequest(indenter, grid, depths, turn, unknown)
    with reporter.task("Cramer-Rao bounds", request.presses) as advance:
        maps = map_limits(sensor, request, advance)
    subject = f"{spec.origin} sensor {_label(spec, settings)}, {_description(request)}"

    def draw() -> Figure:
        from tactibench.report.plots.limit import limit_figure

        return limit_figure(maps, measured_on=subject)

    rows = rows_of(maps)
    identity = {"name": spec.name, "origin": spec.origin, "parameters": dict(settings)}
    tables, remarks = [limit_table(maps)], [*limit_remarks(maps)]
    if maps.spacings is not None:
        tables.append(spacing_table(maps))
        remarks += spacing_remarks(maps)
    return PlotData(
        title="",
        subject=subject,
        tables=tuple(tables),
        rows=rows,
        draw=draw,
        remarks=tuple(remarks),
        document={
            "sensor": {**identity, "description": sensor.describe()},
            **_json(request),
            "metrics": rows,
            "maps_mm": _cells(maps),
            **_spacings(maps),
        },
    )


def _sensor(spec: SensorSpec, values: Mapping[str, Value]) -> Sensor:
    """Return the sensor, ready to compute bounds.

    Raises:
        UserError: The sensor does not know the bound of its frames.
    """
    if not spec.needs_data:
        sensor = spec.load()(SensorContext(np.random.SeedSequence(0)), **values)
        if sensor.covariance(Scene(Indenter.single(), Pose(depth=1.0))) is not None:
            return sensor
    raise UserError(
        f"sensor {spec.name!r} does not know what limits its frames; take a simulated sensor, "
        "for example tactip-127."
    )


def _nuisances(sensor: Sensor, asked: Sequence[str]) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(asked))
    if names == ("all",):
        return tuple(sensor.nuisances)
    for name in names:
        if name not in sensor.nuisances:
            raise UserError(f"unknown nuisance {name!r}; {did_you_mean(name, sensor.nuisances)}")
    return names


def _grid(reach: float, step: float) -> Grid:
    half = math.floor(reach / step + 1e-9)
    cells = 2 * half + 1  # a press at the apex, and whole steps from there
    if cells > MOST_CELLS:
        raise UserError(
            f"--step {step:g} mm makes {cells} presses along +-{reach:g} mm; at most {MOST_CELLS} "
            "are taken, so take larger steps or a smaller --range."
        )
    return Grid.centred(cells, step)


def _label(spec: SensorSpec, values: Mapping[str, Value]) -> str:
    defaults = spec.defaults(values)
    other = [f"{name}={value}" for name, value in values.items() if value != defaults[name]]
    return f"{spec.name}({','.join(other)})" if other else spec.name


def _description(request: LimitRequest) -> str:
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


def _json(request: LimitRequest) -> dict[str, Any]:
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


def _cells(maps: LimitMaps) -> dict[str, Any]:
    """Return the bounds of every quantity as [depth][row][column], mm."""
    return {
        quantity: _nested(maps.values[:, q]) for q, quantity in enumerate(maps.request.quantities)
    }


def _spacings(maps: LimitMaps) -> dict[str, Any]:
    """Return the spacings from which two tips differ from one, with their places; or {}."""
    if maps.spacings is None:
        return {}
    x, y = (axis.round(9).tolist() for axis in maps.request.coarse.axes())
    return {"two_from_one": {"x_mm": x, "y_mm": y, "spacing_mm": _nested(maps.spacings)}}


def _nested(layers: Any) -> list[Any]:
    """Return layers as [depth][row][column]; "inf" without a bound, null for a refused press."""

    def cell(value: float) -> float | str | None:
        return "inf" if math.isinf(value) else None if math.isnan(value) else value

    return [[[cell(v) for v in row] for row in layer] for layer in layers.tolist()]
