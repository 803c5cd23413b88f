"""The heatmap of a model as a deformed surface, beside the true one."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from tactibench.contacts import FloatArray, Grid
from tactibench.report.plots.style import HEAT, headline, new_figure


def relief_figure(
    grid: Grid,
    predicted: FloatArray,
    true: FloatArray | None = None,
    *,
    title: str = "",
    measured_on: str = "",
) -> Figure:
    """Draw (H, W) maps of depth, mm, with one z axis, one colour scale and one viewpoint.

    Depth is inward; it is drawn upwards, because a dent hides its own bottom.

    Args:
        grid: Grid of both maps.
        predicted: Heatmap of a model, mm.
        true: True displacement of the skin, mm; None where the sensor does not know it.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    maps = [("heatmap of the model", predicted)]
    if true is not None:
        maps.append(("true displacement of the skin", true))
    figure = new_figure(4.5 * len(maps), 4.4)
    x, y = np.meshgrid(*grid.axes())
    top = max(*(float(np.max(values)) for _, values in maps), 1e-3)
    bottom = min(*(float(np.min(values)) for _, values in maps), 0.0)
    scale = Normalize(bottom, top)
    panels = []
    for k, (name, values) in enumerate(maps):
        plot: Any = figure.add_subplot(1, len(maps), k + 1, projection="3d")
        panels.append(plot)
        surface = plot.plot_surface(
            x,
            y,
            values,
            cmap=HEAT,
            norm=scale,
            rstride=1,
            cstride=1,
            linewidth=0,
            antialiased=False,
        )
        plot.set(
            title=name,
            xlabel="x, mm",
            ylabel="y, mm",
            zlabel="inward, mm",
            zlim=(bottom, top * 1.02),
        )
        plot.invert_yaxis()  # y grows towards the viewer, as it grows downwards in the frame
        plot.view_init(elev=48, azim=-76)
        plot.set_box_aspect((1, 1, 0.6), zoom=0.88)
        plot.tick_params(labelsize=8)
        plot.patch.set_visible(False)  # the right panel would cover the left one's z label
    figure.colorbar(surface, ax=panels, label="inward displacement, mm", shrink=0.7, pad=0.08)
    headline(figure, title, measured_on)
    return figure
