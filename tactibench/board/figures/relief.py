"""The heatmap as what it is said to be, the deformed surface, beside the true one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.colors import Normalize

from tactibench.board.figures.style import HEAT, figure, headline, save
from tactibench.contacts import Grid


def surfaces(
    path: Path,
    grid: Grid,
    predicted: npt.NDArray[Any],
    true: npt.NDArray[Any],
    *,
    names: tuple[str, str] = ("heatmap of the model", "truth"),
    title: str = "",
    measured_on: str = "",
) -> None:
    """Draw two (H, W) maps of depth, mm, on one z axis, one colour scale and one viewpoint.

    Depth is inward; it is drawn upwards, because a dent hides its own bottom.
    """
    made = figure(9.0, 4.4)
    x, y = np.meshgrid(*grid.axes())
    top = max(float(np.max(predicted)), float(np.max(true)), 1e-3)
    bottom = min(float(np.min(predicted)), float(np.min(true)), 0.0)
    scale = Normalize(bottom, top)
    panels = [made.add_subplot(1, 2, k + 1, projection="3d") for k in range(2)]
    drawn: Any = None
    for axes, values, name in zip(panels, (predicted, true), names, strict=True):
        plot: Any = axes
        drawn = plot.plot_surface(
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
    made.colorbar(drawn, ax=panels, label="inward displacement, mm", shrink=0.7, pad=0.08)
    headline(made, title, measured_on)
    save(made, path)
