"""Cramer-Rao bounds as maps of the workspace."""

from __future__ import annotations

from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from tactibench.board import LimitMaps
from tactibench.report.plots.marks import extent, millimetres
from tactibench.report.plots.style import GREY, HEAT, headline, log_ticks, new_figure

UNBOUNDED = "#FFFFFF"
HATCH = "////"
MICRO = 1000.0
WIDE = 4.0
"""Ratio of the largest to the smallest bound above which a panel's scale is logarithmic."""
LETTERS_AN_INCH = 12
TITLE = "Cramer-Rao bound: smallest standard deviation"
FINE_MM = 0.1
"""A panel whose largest bound is below this is shown in micrometres."""


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
