"""Cramer-Rao bounds over the workspace of a sensor: the numbers, and maps of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from tactibench.board import (
    LimitMaps,
    LimitRequest,
    limit_rows,
    map_limits,
    spacing_summary,
    summary,
)
from tactibench.contacts import Grid, Indenter, Pose, Scene
from tactibench.errors import UserError, did_you_mean
from tactibench.frames import D_PRIME, FALSELY_SEEN, SEEN
from tactibench.plugins import PluginHost, Sensor, SensorContext, SensorSpec, Value
from tactibench.report.frame_plots import extent, millimetres
from tactibench.report.plot_data import PlotData
from tactibench.report.style import GREY, HEAT, headline, in_own_style, log_ticks, new_figure
from tactibench.report.tables import Cell, Column, Head, Number, Table, table
from tactibench.run import Reporter

MOST_CELLS = 101
"""Most cells along one side of the map: a finer map takes minutes and shows nothing more."""
SPACING_MM = 7.0
"""Spacing of two tips where none is given."""
QUANTILES: tuple[Head, ...] = (
    *("middle", "median", "90 %", "worst", "at x, y mm"),
    Column("presses"),
)
UNBOUNDED = "#FFFFFF"
HATCH = "////"
MICRO = 1000.0
WIDE = 4.0
"""Ratio of the largest to the smallest bound above which a panel's scale is logarithmic."""
LETTERS_AN_INCH = 12
TITLE = "Cramer-Rao bound: smallest standard deviation"
FINE_MM = 0.1
"""A panel whose largest bound is below this is shown in micrometres."""


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
    defaults = spec.defaults(settings)
    other = [f"{key}={value}" for key, value in settings.items() if value != defaults[key]]
    label = f"{spec.name}({','.join(other)})" if other else spec.name
    subject = f"{spec.origin} sensor {label}, {_description(request)}"

    rows = limit_rows(maps)
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
        draw=partial(limit_figure, maps, measured_on=subject),
        remarks=tuple(remarks),
        document={
            "sensor": {**identity, "description": sensor.describe()},
            **_json(request),
            "metrics": rows,
            "maps_mm": {
                quantity: _nested(maps.values[:, q])
                for q, quantity in enumerate(request.quantities)
            },
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


def limit_table(maps: LimitMaps) -> Table:
    """Return the quantiles over the workspace, um, with one row per depth and quantity."""
    rows: list[list[Cell]] = []
    last = None
    for line in summary(maps):
        depth = "" if line["depth"] == last else f"{line['depth']:g}"
        rows.append([depth, line["quantity"], *_quantiles(line, micrometres)])
        last = line["depth"]
    title = "Cramer-Rao bound: smallest standard deviation, um"
    return table(("depth, mm", "sd of", *QUANTILES), rows, title=title)


def spacing_table(maps: LimitMaps) -> Table:
    """Return the spacings from which two tips differ from one, mm, with one row per depth."""

    def millimetre(value: float) -> str:
        return "none" if math.isinf(value) else f"{value:.2f}"

    rows = [[f"{line['depth']:g}", *_quantiles(line, millimetre)] for line in spacing_summary(maps)]
    title = "Two tips differ from one from this spacing on, mm"
    return table(("depth, mm", *QUANTILES), rows, title=title)


def _quantiles(line: Mapping[str, Any], write: Callable[[float], str]) -> Iterator[Cell]:
    """Yield the cells of QUANTILES."""
    for name in ("middle", "median", "p90", "worst"):
        value = line.get(name)
        yield None if value is None or math.isnan(value) else Number(value, write)
    yield "{:+.1f}, {:+.1f}".format(*line["worst_at"]) if "worst_at" in line else ""
    yield f"{line['n']:,}"


def micrometres(value: float) -> str:
    """Return mm as um with three digits: "0.834", "12.9", "1,480"; "inf" without a bound."""
    if math.isinf(value):
        return "inf"
    micro = 1000 * value
    return f"{micro:,.0f}" if micro >= 999.5 else f"{micro:#.3g}"


def limit_remarks(maps: LimitMaps) -> Iterator[str]:
    """Yield what the numbers leave out, one sentence each."""
    per_depth = summary(maps)[:: len(maps.request.quantities)]
    presses = f"of {maps.request.presses:,} presses"
    if len(maps.request.indenter.offsets) > 1:
        yield "x, y, depth: of the worse of the two tips."
    if unbounded := sum(line["unbounded"] for line in per_depth):
        yield f"{unbounded:,} {presses} have no bound, since a tip leaves no trace."
    if refused := sum(line["refused"] for line in per_depth):
        yield f"{refused:,} {presses} are refused: {maps.refusal}"


def spacing_remarks(maps: LimitMaps) -> Iterator[str]:
    """Yield how the spacings were decided and what they leave out, one sentence each."""
    diameter = 2 * maps.request.indenter.radius
    yield (
        f"Smallest spacing at which an ideal observer of the frames sees {SEEN:.0%} of the pairs, "
        f"and {FALSELY_SEEN:.0%} of single presses, as two (d' = {D_PRIME:.1f}); "
        "the --spacing does not enter."
    )
    yield f"Below {diameter:g} mm the two spheres overlap: two tips of one tool."
    lines = spacing_summary(maps)
    if unbounded := sum(line["unbounded"] for line in lines):
        total = len(lines) * math.prod(maps.request.coarse.shape)
        presses = f"{unbounded:,} of {total:,} presses"
        yield f"{presses} have no such spacing: one tip leaves the dome before."


@in_own_style
def limit_figure(maps: LimitMaps, *, title: str = TITLE, measured_on: str = "") -> Figure:
    """Draw one panel per depth (rows) and quantity (columns), each with its own colour scale.

    Bounds are standard deviations (sd), um, or mm where they reach 0.1 mm. Cells without a bound
    are hatched, cells that the sensor refuses are empty.

    Args:
        maps: Limits over the workspace.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    request = maps.request
    rows, columns = len(request.depths), len(request.quantities)
    figure = new_figure(0.6 + 2.75 * columns, 1.0 + 2.45 * rows)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for d, depth in enumerate(request.depths):
        for q, quantity in enumerate(request.quantities):
            axes: Axes = panels[d, q]
            image, unit = _show_map(axes, maps, maps.values[d, q])
            axes.set_title(f"{quantity}, depth {depth:g} mm", fontsize=9)
            millimetres(axes, request.grid)
            axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
            axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
            axes.label_outer()
            axes.tick_params(labelsize=8)
            if image is not None:
                bar = figure.colorbar(image, ax=axes, shrink=0.9, pad=0.03)
                bar.set_label(f"sd of {quantity}, {unit}", fontsize=8)
                if isinstance(image.norm, LogNorm):
                    log_ticks(bar.ax.yaxis)
                else:
                    bar.ax.yaxis.set_major_locator(MaxNLocator(5))
                bar.ax.tick_params(labelsize=8)
    marks = _legend(maps)
    if marks:
        figure.legend(handles=marks, loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    headline(figure, title, fill(measured_on, round(LETTERS_AN_INCH * figure.get_figwidth())))
    return figure


def _show_map(axes: Axes, maps: LimitMaps, layer: Any) -> tuple[Any, str]:
    """Draw one map and return its image with its unit; None and "" where no cell has a bound."""
    finite = np.isfinite(layer)
    left, right, bottom, top = extent(maps.request.grid)
    if np.isinf(layer).any():
        x = np.linspace(left, right, layer.shape[1] + 1)
        y = np.linspace(top, bottom, layer.shape[0] + 1)
        cells = np.ma.masked_where(~np.isinf(layer), np.ones(layer.shape))
        axes.pcolor(
            x, y, cells, cmap=ListedColormap([UNBOUNDED]), edgecolor=GREY, hatch=HATCH, linewidth=0
        )
    if not finite.any():
        return None, ""
    fine = layer[finite].max() < FINE_MM
    shown = np.ma.masked_where(~finite, layer * (MICRO if fine else 1.0))
    low, high = float(shown.min()), float(shown.max())
    if high < low * 1.001:  # one colour rather than a picture of rounding errors
        low, high = low * 0.95, high * 1.05
    scale = LogNorm(low, high) if high > WIDE * low else Normalize(low, high)
    image = axes.imshow(
        shown, cmap=HEAT, norm=scale, interpolation="nearest", extent=(left, right, bottom, top)
    )
    return image, "\N{MICRO SIGN}m" if fine else "mm"


def _legend(maps: LimitMaps) -> list[Patch]:
    patches = []
    if np.isinf(maps.values).any():
        patches.append(
            Patch(
                facecolor=UNBOUNDED,
                edgecolor=GREY,
                hatch=HATCH,
                linewidth=0,
                label="no bound: a tip leaves no trace",
            )
        )
    if np.isnan(maps.values).any():
        patches.append(
            Patch(
                facecolor="white",
                edgecolor=GREY,
                linewidth=0.5,
                label="empty: outside what the sensor can press",
            )
        )
    return patches
