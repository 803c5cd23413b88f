"""Test frames and their contacts: camera image, prediction and truth, of one model or several.

True contacts are rings of the tip's radius, predicted ones marks; both have their depth in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from tactibench.contacts import Contacts, Grid
from tactibench.report.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    HEAT,
    VERMILION,
    headline,
    in_own_style,
    legend_below,
    legend_mark,
    new_figure,
    plain,
    short_label,
)

TIP_RADIUS_MM = 3.0
OUTLINE = [withStroke(linewidth=2.6, foreground="white")]
"""A contour that keeps a mark visible on light and dark cells."""
RING: dict[str, Any] = {"color": BLACK, "linewidth": 1.5, "path_effects": OUTLINE}
CROSS: dict[str, Any] = {
    "color": VERMILION,
    "marker": "x",
    "markersize": 8,
    "markeredgewidth": 1.8,
    "path_effects": OUTLINE,
}
NUMBER: dict[str, Any] = {
    "fontsize": 8.5,
    "ha": "center",
    "va": "center",
    "clip_on": True,
    "path_effects": OUTLINE,
}
LETTERS = 30
"""Longest line of a label above its panel."""
AXES = (("x", BLUE), ("y", VERMILION), ("z (depth)", GREEN))


@dataclass(frozen=True, eq=False)
class FrameExample:
    """A test frame with its truth and the prediction of a model.

    Attributes:
        image: (H, W) or (H, W, 3) uint8.
        grid: Grid of the heatmap.
        heatmap: (rows, columns) of the grid in 0..1; None for a model without heatmaps.
        truth: The true contacts.
        predicted: The predicted contacts.
        max_depth: Depth that a heatmap value of 1 stands for, mm.
    """

    image: npt.NDArray[Any]
    grid: Grid
    heatmap: npt.NDArray[Any] | None
    truth: Contacts
    predicted: Contacts
    max_depth: float


def extent(grid: Grid) -> tuple[float, float, float, float]:
    """Return left, right, bottom, top of the outermost cell borders, mm; y runs downwards."""
    x, y = grid.axes()
    half = grid.pitch / 2
    return x[0] - half, x[-1] + half, y[-1] + half, y[0] - half


def millimetres(axes: Axes, grid: Grid) -> None:
    """Set the limits of the axes to the grid, with equal scales and labels in mm."""
    left, right, bottom, top = extent(grid)
    axes.set(xlim=(left, right), ylim=(bottom, top), xlabel="x, mm", ylabel="y, mm", aspect="equal")


@in_own_style
def contacts_figure(
    examples: Sequence[tuple[str, FrameExample]], *, title: str = "", measured_on: str = ""
) -> Figure:
    """Draw a column for every example: the frame above, the contacts below, with depths in mm.

    They stand beside each other where there is one example.

    Rings of the tip's radius are true contacts, crosses predicted ones. The heatmap lies below
    them, where the model has one.

    Args:
        examples: Caption and frame of every column.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    count = len(examples)
    size, shape = ((7.0, 4.0), (1, 2)) if count == 1 else ((3.4 * count, 6.6), (2, count))
    figure = new_figure(*size)
    panels = figure.subplots(*shape, squeeze=False).reshape(2, count)
    for (caption, example), image, field in zip(examples, *panels, strict=True):
        image.imshow(example.image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
        image.set(xlabel="column, px", ylabel="row, px")
        counts = f"{len(example.predicted)} predicted, {len(example.truth)} true"
        image.set_title(f"{fill(short_label(caption), LETTERS)}\n{counts}", fontsize=9)
        if example.heatmap is not None:
            depth, most = example.heatmap * example.max_depth, example.max_depth
            shown = field.imshow(depth, cmap=HEAT, vmin=0, vmax=most, extent=extent(example.grid))
            figure.colorbar(shown, ax=field, label="heatmap, mm", shrink=0.85)
        for xy in example.truth.xy:
            field.add_patch(Circle(tuple(xy), TIP_RADIUS_MM, fill=False, **RING))
        field.plot(*example.predicted.xy.T, linestyle="none", **CROSS)
        for contacts, side, look in ((example.truth, -1, RING), (example.predicted, 1, CROSS)):
            for (x, y), depth in zip(contacts.xy, contacts.depth, strict=True):
                place = x, y + side * (TIP_RADIUS_MM + 1.2)
                text = "" if np.isnan(depth) else f"{depth:.1f}"
                field.text(*place, text, **NUMBER, color=look["color"])
        millimetres(field, example.grid)
    ring = {**RING, "marker": "o", "markersize": 11, "markerfacecolor": "none"}
    handles = [legend_mark("truth, depth in mm above", **ring)]
    legend_below(figure, 2, [*handles, legend_mark("predicted, depth in mm below", **CROSS)])
    headline(figure, title, measured_on)
    return figure


@in_own_style
def single_figure(
    truth: npt.ArrayLike, predicted: npt.ArrayLike, *, title: str = "", measured_on: str = ""
) -> Figure:
    """Draw true against predicted x, y, depth above, and histograms of errors below.

    Args:
        truth: (N, 3) true x, y, depth, mm; a depth that is not known, NaN, is not drawn.
        predicted: (N, 3) predicted x, y, depth, mm.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    true, estimate = (np.asarray(v, dtype=np.float64).reshape(-1, 3) for v in (truth, predicted))
    error = estimate - true
    known = [k for k in range(len(AXES)) if not np.isnan(error[:, k]).any()]
    figure = new_figure(9.0, 5.8)
    panels = figure.subplots(2, len(known), height_ratios=[3, 2])
    for k, (scatter, histogram) in zip(known, panels.T, strict=True):
        name, colour = AXES[k]
        scatter.axline((0, 0), slope=1, color=GREY, linewidth=1, zorder=1)
        scatter.plot(true[:, k], estimate[:, k], ".", color=colour, markersize=3, alpha=0.6)
        scatter.set(xlabel=f"true {name}, mm", ylabel=f"predicted {name}, mm")
        histogram.hist(error[:, k], bins=41, color=colour)
        histogram.set(xlabel=f"error of {name}, mm", ylabel="presses")
        mae = f"MAE {np.abs(error[:, k]).mean():.4f} mm" if len(error) else "no predictions"
        histogram.set_title(mae, fontsize=9)
        for axes in (scatter, histogram):
            axes.xaxis.set_major_locator(MaxNLocator(4))  # labels of small errors are long
            plain(axes)
    headline(figure, title, measured_on, f"{len(true):,} presses")
    return figure
