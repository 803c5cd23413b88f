"""Test frames: the camera image, the prediction of a model, its layers, and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tactibench.report.plots.marks import FrameExample, marks, outline, show_field, show_image
from tactibench.report.plots.style import (
    BLACK,
    HEAT,
    ORANGE,
    headline,
    legend_below,
    legend_mark,
    new_figure,
)

Layer = tuple[str, int, npt.NDArray[Any]]
"""Name, number of channels, and (K, H, W) of the channels that are shown."""
TILES = 6
"""Most channels of a layer that are shown."""


def frame_figure(example: FrameExample, *, title: str = "", measured_on: str = "") -> Figure:
    """Draw a frame beside the prediction; rings are true contacts, crosses predicted ones."""
    figure = new_figure(8.0, 4.6)
    left, right = figure.subplots(1, 2)
    show_image(left, example.image)
    _show_prediction(figure, right, example)
    right.set_title("prediction" if example.heatmap is not None else "prediction (no heatmap)")
    handles = [_ring(f"truth ({len(example.truth)}), ring: tip, number: depth in mm")]
    depths = ", ".join(f"{depth:.1f}" for depth in example.predicted.depth)
    text = f"predicted ({len(example.predicted)})" + (f", depth {depths} mm" if depths else "")
    handles.append(_cross(text))
    legend_below(figure, 2, handles)
    headline(figure, title, measured_on)
    return figure


def worst_frames_figure(
    examples: Sequence[tuple[str, FrameExample]], *, title: str = "", measured_on: str = ""
) -> Figure:
    """Draw frames with large errors, one column each.

    Args:
        examples: Caption and frame of every column.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    figure = new_figure(3.4 * len(examples), 6.6)
    panels = figure.subplots(2, len(examples), squeeze=False)
    for k, (caption, example) in enumerate(examples):
        show_image(panels[0, k], example.image)
        panels[0, k].set_title(caption, fontsize=9)
        _show_prediction(figure, panels[1, k], example)
    handles = [_ring("truth, number: depth in mm"), _cross("predicted")]
    legend_below(figure, 2, handles)
    headline(figure, title, measured_on)
    return figure


def features_figure(
    example: FrameExample, layers: Sequence[Layer], *, title: str = "", measured_on: str = ""
) -> Figure:
    """Draw the frame, the layers down the left and up the right, and the prediction.

    Every channel has its own scale from its smallest to its largest activation.

    Args:
        example: The frame.
        layers: Layers of the model, in the order of the forward pass.
        title: Title of the picture.
        measured_on: Printed as subtitle.
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


def _show_prediction(figure: Figure, axes: Axes, example: FrameExample) -> None:
    shown = show_field(axes, example.grid, example.heatmap, example.truth, example.max_depth)
    marks(axes, example.predicted, ORANGE)
    if shown is not None:
        figure.colorbar(shown, ax=axes, label="heatmap, mm", shrink=0.85)


def _ring(label: str) -> Line2D:
    return legend_mark(label, color=BLACK, marker="o", markersize=11, markerfacecolor="none")


def _cross(label: str) -> Line2D:
    look = {"color": ORANGE, "marker": "x", "markersize": 8, "markeredgewidth": 1.8}
    return legend_mark(label, path_effects=outline(), **look)


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
