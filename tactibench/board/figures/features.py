"""What the layers of a network make of one frame, after the feature maps of TactiVerse."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from tactibench.board.figures.marks import heat, marks, millimetres, rings
from tactibench.board.figures.style import BLACK, HEAT, ORANGE, figure, headline, save
from tactibench.contacts import Contacts, Grid

Layer = tuple[str, int, npt.NDArray[Any]]
"""Name, number of channels, (<= K, H, W) of them."""
TILES = 6


def feature_maps(
    path: Path,
    image: npt.NDArray[Any],
    layers: Sequence[Layer],
    grid: Grid,
    heatmap: npt.NDArray[Any] | None,
    truth: Contacts,
    predicted: Contacts,
    max_depth: float,
    *,
    title: str = "",
    measured_on: str = "",
) -> None:
    """Draw the frame, the layers down the left and up the right, and the answer.

    Every channel has its own scale from its least to its greatest activation. heatmap: (H, W) in
    0..1, or None.
    """
    rows = -(-len(layers) // 2)
    made = figure(10.0, 3.1 + 0.98 * rows)
    parts: Any = made.subfigures(2, 1, height_ratios=[2.7, max(0.98 * rows, 0.1)])
    top, below = parts
    seen, answer = top.subplots(1, 2)
    seen.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    seen.set(title="frame", xlabel="column, px", ylabel="row, px")
    if heatmap is None:
        answer.set_facecolor("#F2F2F2")
    else:
        top.colorbar(heat(answer, grid, heatmap, max_depth), ax=answer, label="heatmap, mm")
    contour = "white" if heatmap is None else "black"
    rings(answer, truth, BLACK if heatmap is None else "white", contour=contour)
    marks(answer, predicted, ORANGE)
    millimetres(answer, grid)
    answer.set_title(f"answer: {len(predicted)} of {len(truth)} contacts (rings)")
    if rows:
        tiles = below.subplots(rows, 2 * TILES, squeeze=False, gridspec_kw={"wspace": 0.04})
        for axes in tiles.flat:
            axes.set_axis_off()
        for k, layer in enumerate(layers):
            left = k < rows
            row, start = (k, 0) if left else (2 * rows - 1 - k, TILES)
            _strip(tiles[row, start : start + TILES], layer)
    headline(made, title, measured_on)
    save(made, path)


def _strip(tiles: Sequence[Axes], layer: Layer) -> None:
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
