"""Cramer-Rao bounds over the workspace of a sensor: the numbers, and maps of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactibench.board import (
    TWO_FROM_ONE,
    LimitMaps,
    LimitRequest,
    limit_rows,
    map_limits,
    summary,
)
from tactibench.contacts import Grid, Indenter, Pose, Scene
from tactibench.errors import UserError, did_you_mean
from tactibench.frames import D_PRIME, FALSELY_SEEN, SEEN
from tactibench.plugins import PluginHost, Sensor, SensorContext, SensorSpec
from tactibench.records import BoundSpec
from tactibench.report.frame_plots import extent, millimetres
from tactibench.report.style import HEAT, PlotData, headline, in_own_style, new_figure
from tactibench.report.tables import Cell, Column, Head, Number, Table, table
from tactibench.run import Reporter

MOST_CELLS = 101
"""Most cells along one side of the map: a finer map takes minutes and shows nothing more."""
MOST_MM = 40.0
"""Largest length that is asked for: no sensor is larger."""
LETTERS_AN_INCH = 12
SPACING_MM = 7.0
"""Spacing of two tips where none is given."""
QUANTILES: tuple[Head, ...] = ("middle", "median", "90 %", "worst", "at x, y mm", Column("presses"))


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
    distance = SPACING_MM if spacing is None else spacing
    depths = tuple(map(float, depths))
    lengths = [("radius", radius), ("spacing", distance), ("step", step)]
    for quantity, value in (*lengths, *(("depth", depth) for depth in depths or (0.0,))):
        if not 0 < value <= MOST_MM:
            raise UserError(f"{quantity} {value:g} mm is not above 0 and at most {MOST_MM:g} mm.")
    if not 0 <= reach <= MOST_MM:
        raise UserError(f"range {reach:g} mm is not from 0 to {MOST_MM:g} mm.")
    if yaw is not None and not math.isfinite(yaw):
        raise UserError(f"yaw {yaw:g} deg is not a finite angle; take one such as 45.")
    bound = BoundSpec.named(PluginHost().sensors, name, params)
    sensor = _sensor(bound)
    indenter = Indenter.single(radius) if scene == "single" else Indenter.dual(distance, radius)
    unknown, grid = _nuisances(sensor, nuisances), _grid(reach, step)
    request = LimitRequest(indenter, grid, depths, yaw or 0.0, unknown)
    with reporter.task("Cramer-Rao bounds", request.presses) as advance:
        maps = map_limits(sensor, request, advance)
    subject = f"{bound.spec.origin} sensor {bound.label}, {_description(request)}"

    draw = partial(limit_figure, maps, measured_on=subject)
    return PlotData(subject, limit_tables(maps), limit_rows(maps), draw, tuple(limit_remarks(maps)))


def _sensor(bound: BoundSpec[SensorSpec]) -> Sensor:
    """Return the sensor, ready to compute bounds.

    Raises:
        UserError: The sensor does not know the bound of its frames.
    """
    if not bound.spec.needs_data:
        sensor: Sensor = bound.build(SensorContext(np.random.SeedSequence(0)))
        if sensor.covariance(Scene(Indenter.single(), Pose(depth=1.0))) is not None:
            return sensor
    raise UserError(
        f"sensor {bound.name!r} does not know what limits its frames; take a simulated sensor, "
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
    steps = reach / step + 1e-9
    if 2 * steps >= MOST_CELLS + 1:
        raise UserError(
            f"--step {step:g} mm makes more than {MOST_CELLS} presses along +-{reach:g} mm; take "
            "larger steps or a smaller --range."
        )
    return Grid.centred(2 * math.floor(steps) + 1, step)  # one at the apex, whole steps from there


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


def limit_tables(maps: LimitMaps) -> tuple[Table, ...]:
    """Return the quantiles over the workspace, with one row per depth and quantity.

    Bounds are in um; the spacings from which two tips differ from one are in mm, in a table of
    their own.
    """
    write = "{:.2f}".format
    bounds: list[list[Cell]] = [
        [f"{line['depth']:g}", line["quantity"], *_quantiles(line, micrometres)]
        for line in summary(maps)
        if line["quantity"] != TWO_FROM_ONE
    ]
    spacings = [
        [f"{line['depth']:g}", *_quantiles(line, write)] for line in _of(maps, TWO_FROM_ONE)
    ]
    title = "Cramer-Rao bound: smallest standard deviation, um"
    bound_table = table(("depth, mm", "sd of", *QUANTILES), bounds, title=title)
    if not spacings:
        return (bound_table,)
    title = "Two tips differ from one from this spacing on, mm"
    return bound_table, table(("depth, mm", *QUANTILES), spacings, title=title)


def _of(maps: LimitMaps, quantity: str) -> list[dict[str, Any]]:
    """Return the line of a quantity for every depth."""
    return [line for line in summary(maps) if line["quantity"] == quantity]


def _quantiles(line: Mapping[str, Any], write: Callable[[float], str]) -> Iterator[Cell]:
    """Yield the cells of QUANTILES."""
    for name in ("middle", "median", "p90", "worst"):
        value = line.get(name, math.nan)
        yield None if math.isnan(value) else Number(value, write)
    yield "{:+.1f}, {:+.1f}".format(*line["worst_at"]) if "worst_at" in line else ""
    yield f"{line['n']:,}"


def micrometres(value: float) -> str:
    """Return mm as um with three digits: "0.834", "12.9", "1,480"; "inf" without a bound."""
    if math.isinf(value):
        return "inf"
    micro = 1000 * value
    return f"{micro:,.0f}" if micro >= 999.5 else f"{micro:#.3g}"


def limit_remarks(maps: LimitMaps) -> Iterator[str]:
    """Yield what the numbers leave out and how spacings were decided, one sentence each."""
    per_depth = _of(maps, "x")
    presses = f"of {maps.request.presses:,} presses"
    if len(maps.request.indenter.offsets) > 1:
        yield "x, y, depth: of the worse of the two tips."
    if unbounded := sum(line["unbounded"] for line in per_depth):
        yield f"{unbounded:,} {presses} have no bound, since a tip leaves no trace."
    if refused := sum(line["refused"] for line in per_depth):
        yield f"{refused:,} {presses} are refused: {maps.refusal}"

    if maps.spacings is None:
        return
    diameter = 2 * maps.request.indenter.radius
    yield (
        f"Smallest spacing at which an ideal observer of the frames sees {SEEN:.0%} of the pairs, "
        f"and {FALSELY_SEEN:.0%} of single presses, as two (d' = {D_PRIME:.1f}); "
        "the --spacing does not enter."
    )
    yield f"Below {diameter:g} mm the two spheres overlap: two tips of one tool."
    lines = _of(maps, TWO_FROM_ONE)
    if unbounded := sum(line["unbounded"] for line in lines):
        total = len(lines) * math.prod(maps.request.coarse.shape)
        presses = f"{unbounded:,} of {total:,} presses"
        yield f"{presses} have no such spacing: one tip leaves the dome before."


@in_own_style
def limit_figure(maps: LimitMaps, *, measured_on: str = "") -> Figure:
    """Draw one panel per depth (rows) and quantity (columns), each with its own colour scale.

    Cells without a bound, and those that the sensor refuses, are empty.

    Args:
        maps: Limits over the workspace.
        measured_on: Printed as subtitle.
    """
    request = maps.request
    rows, columns = len(request.depths), len(request.quantities)
    figure = new_figure(0.6 + 2.75 * columns, 1.0 + 2.45 * rows)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for d, depth in enumerate(request.depths):
        for q, quantity in enumerate(request.quantities):
            axes: Axes = panels[d, q]
            micro = np.ma.masked_invalid(1000 * maps.values[d, q])
            shown = axes.imshow(micro, cmap=HEAT, extent=extent(request.grid))
            axes.set_title(f"{quantity}, depth {depth:g} mm", fontsize=9)
            millimetres(axes, request.grid)
            axes.label_outer()
            axes.tick_params(labelsize=8)
            if micro.count():
                label = f"sd of {quantity}, \N{MICRO SIGN}m"
                figure.colorbar(shown, ax=axes, shrink=0.9, pad=0.03, label=label)
    empty = "" if np.isfinite(maps.values).all() else "empty: no bound, or outside the reach"
    details = fill("; ".join(filter(None, (measured_on, empty))), LETTERS_AN_INCH * 3 * columns)
    headline(figure, "Cramer-Rao bound: smallest standard deviation", details)
    return figure
