"""The smallest errors that a sensor's noise allows, as a figure with its numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from tactibench.board.limits import LimitMaps, LimitRequest, map_limits, rows_of
from tactibench.contacts import Grid, Indenter, Pose, Scene
from tactibench.errors import UserError, did_you_mean
from tactibench.plugins.base import Sensor, SensorContext
from tactibench.plugins.host import PluginHost
from tactibench.plugins.parameter import Value
from tactibench.plugins.specs import SensorSpec
from tactibench.report.plot_data import PlotData
from tactibench.report.plot_tables import (
    limit_remarks,
    limit_table,
    spacing_remarks,
    spacing_table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_CELLS = 101
"""Most cells along one side of the map: a finer map takes minutes and shows nothing more."""
SPACING_MM = 7.0
"""Spacing of two tips where none is given."""


@dataclass(frozen=True)
class LimitOptions:
    """The presses whose limits are computed. Lengths are in mm, yaw is in degrees.

    Attributes:
        sensor: Name of a simulated sensor.
        parameters: Parameters of the sensor that are not at their defaults.
        scene: "single" or "dual".
        depths: Depths of the presses.
        spacing: Spacing of two tips; None: 7.
        yaw: Yaw of two tips; None: 0.
        radius: Radius of the tips.
        reach: Half side of the workspace.
        step: Step between the presses.
        nuisances: Unknown properties of the camera; ("all",) for all.
    """

    sensor: str = "tactip-127"
    parameters: Mapping[str, str] = field(default_factory=dict)
    scene: str = "single"
    depths: Sequence[float] = (1.0, 3.0, 6.0)
    spacing: float | None = None
    yaw: float | None = None
    radius: float = 3.0
    reach: float = 6.4
    step: float = 0.8
    nuisances: Sequence[str] = ()


@dataclass(frozen=True)
class LimitData(PlotData):
    """A figure of limits.

    Attributes:
        maps: The limits over the workspace.
        document: JSON values that ``tactibench plot limit --json`` writes.
    """

    maps: LimitMaps = field(kw_only=True, repr=False)
    document: Mapping[str, Any] = field(kw_only=True, repr=False)


@dataclass(frozen=True)
class LimitPlan:
    """A sensor that is ready, and the presses on it.

    Attributes:
        spec: Spec of the sensor.
        values: Values of its parameters.
        sensor: The sensor.
        request: The presses.
    """

    spec: SensorSpec
    values: Mapping[str, Value]
    sensor: Sensor
    request: LimitRequest

    @property
    def subject(self) -> str:
        """Sensor, tips, workspace and unknown properties, in words."""
        label = _label(self.spec, self.values)
        return f"{self.spec.origin} sensor {label}, {_description(self.request)}"


def limit_plan(options: LimitOptions) -> LimitPlan:
    """Return the sensor and the presses of a computation, which is not started yet.

    Raises:
        UserError: The sensor or a nuisance does not exist, or the options do not fit.
    """
    if options.scene not in ("single", "dual"):
        raise UserError(f"there is no scene {options.scene!r}; take 'single' or 'dual'.")
    if options.scene == "single" and (options.spacing is not None or options.yaw is not None):
        raise UserError("--spacing and --yaw belong to two tips; add --scene dual.")
    if not (options.step > 0 and options.reach >= 0):
        raise UserError("the step must be above 0 mm and the range not below 0.")
    spec = PluginHost().sensors[options.sensor]
    values = spec.settings(dict(options.parameters))
    sensor = _sensor(spec, values)
    if options.scene == "single":
        indenter = Indenter.single(options.radius)
    else:
        indenter = Indenter.dual(options.spacing or SPACING_MM, options.radius)
    unknown = _nuisances(sensor, options.nuisances)
    grid = _grid(options.reach, options.step)
    depths = tuple(map(float, options.depths))
    request = LimitRequest(indenter, grid, depths, options.yaw or 0.0, unknown)
    return LimitPlan(spec, values, sensor, request)


def limit_data(plan: LimitPlan, advance: Callable[[int], None] = lambda _: None) -> LimitData:
    """Return the limits of a sensor over its workspace.

    Args:
        plan: Sensor and presses.
        advance: Called with the number of presses that were done.

    Raises:
        UserError: The sensor refuses all presses.
    """
    request = plan.request
    maps = map_limits(plan.sensor, request, advance)

    def draw() -> Figure:
        from tactibench.report.plots.limit import limit_figure

        return limit_figure(maps, measured_on=plan.subject)

    spec, values, rows = plan.spec, dict(plan.values), rows_of(maps)
    identity = {"name": spec.name, "origin": spec.origin, "parameters": values}
    tables, remarks = [limit_table(maps)], [*limit_remarks(maps)]
    if maps.spacings is not None:
        tables.append(spacing_table(maps))
        remarks += spacing_remarks(maps)
    return LimitData(
        title="",
        subject=plan.subject,
        tables=tuple(tables),
        rows=rows,
        draw=draw,
        remarks=tuple(remarks),
        maps=maps,
        document={
            "sensor": {**identity, "description": plan.sensor.describe()},
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
