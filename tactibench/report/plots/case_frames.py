"""One frame of every hard case, a row a family."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from tactibench.protocols.families import Axis
from tactibench.report.plots.style import headline, new_figure

BLOCKS = 2
"""Families side by side: a page is wider than a row is long."""
SHARE = 0.7
"""Of a frame's sides, around the middle, that is shown: beyond are no pins."""


def case_frames_figure(
    frames: Mapping[str, npt.NDArray[Any]], axes: Sequence[Axis], *, title: str = ""
) -> Figure:
    """Draw the frames (group -> image), cut to the pins, each under its value.

    The easy case comes first. Families without a frame are left out.
    """
    shown = [(axis, [(v, frames[g]) for v, g in _cases(axis) if g in frames]) for axis in axes]
    shown = [(axis, cells) for axis, cells in shown if cells]
    most = min(7, max(len(cells) for _, cells in shown))
    down = -(-len(shown) // BLOCKS)
    figure = new_figure(0.52 * BLOCKS * (most + 1.2), 0.66 * down + 0.5)
    grid = figure.subplots(down, BLOCKS * (most + 1), squeeze=False)
    for panel in grid.flat:
        panel.set_axis_off()
    for k, (axis, cells) in enumerate(shown):
        row, first = k % down, k // down * (most + 1)
        name = f"{axis.family}\n{axis.unit}" if axis.unit else axis.family
        grid[row, first].text(
            1.0,
            0.5,
            name,
            fontsize=6.5,
            ha="right",
            va="center",
            transform=grid[row, first].transAxes,
        )
        selection = cells if len(cells) <= most else [cells[0], *cells[-(most - 1) :]]
        for panel, (value, image) in zip(grid[row, first + 1 :], selection, strict=False):
            panel.imshow(_cut(image), cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            panel.set_title(f"{value:g}", fontsize=6, pad=1.5)
    headline(figure, title, "")
    return figure


def _cases(axis: Axis) -> list[tuple[float, str]]:
    own = list(zip(axis.values, axis.groups, strict=True))
    return own if axis.easy is None else [(axis.easy, axis.reference), *own]


def _cut(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    margin = [round(n * (1 - SHARE) / 2) for n in image.shape[:2]]
    return np.asarray(image[margin[0] : -margin[0] or None, margin[1] : -margin[1] or None])
