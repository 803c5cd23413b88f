"""Feature maps of the layers of a network on one frame, after those of TactiVerse."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactibench.report.plots.marks import FrameExample, marks, show_field, show_image
from tactibench.report.plots.style import HEAT, ORANGE, headline, new_figure

Layer = tuple[str, int, npt.NDArray[Any]]
"""Name, number of channels, (<= K, H, W) of them."""
TILES = 6


def features_figure(
    example: FrameExample, layers: Sequence[Layer], *, title: str = "", measured_on: str = ""
) -> Figure:
    """Draw the frame, the layers down the left and up the right, and the prediction.

    Every channel has its own scale from its least to its greatest activation.
    """
    rows = -(-len(layers) // 2)
    figure = new_figure(10.0, 3.1 + 0.98 * rows)
    parts: Any = figure.subfigures(2, 1, height_ratios=[2.7, max(0.98 * rows, 0.1)])
    top, below = parts
    left, right = top.subplots(1, 2)
    show_image(left, example.image)
    shown = show_field(right, example.grid, example.heatmap, example.truth, example.max_depth)
    if shown is not None:
        top.colorbar(shown, ax=right, label="heatmap, mm")
    marks(right, example.predicted, ORANGE)
    count, true = len(example.predicted), len(example.truth)
    right.set_title(f"prediction: {count} of {true} contacts (rings)")
    if rows:
        tiles = below.subplots(rows, 2 * TILES, squeeze=False, gridspec_kw={"wspace": 0.04})
        for axes in tiles.flat:
            axes.set_axis_off()
        for k, layer in enumerate(layers):
            row, start = (k, 0) if k < rows else (2 * rows - 1 - k, TILES)
            _show_layer(tiles[row, start : start + TILES], layer)
    headline(figure, title, measured_on)
    return figure


def _show_layer(tiles: Sequence[Axes], layer: Layer) -> None:
    name, channels, values = layer
    for axes, channel in zip(tiles, values, strict=False):
        low, high = float(np.min(channel)), float(np.max(channel))
        axes.imshow(
            channel,
            cmap=HEAT,
            vmin=low,
            vmax=high if high > low else low + 1.0,
            interpolation="nearest",
        )
    rows, columns = values.shape[1:]
    text = f"{name}: {channels} of {rows} x {columns}"
    tiles[0].set_title(text, fontsize=8, loc="left", pad=3)
