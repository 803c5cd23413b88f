"""Contacts in millimetres: true ones as rings, predicted ones as marks, both with their depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from tactibench.contacts import Contacts, FloatArray, Grid
from tactibench.report.plots.style import BLACK, HEAT

TIP_RADIUS_MM = 3.0
EMPTY_FIELD = "#F2F2F2"
"""Background of a panel of a model without heatmaps."""


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


def show_image(axes: Axes, image: npt.NDArray[Any]) -> None:
    """Draw a camera frame in pixels."""
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    axes.set(title="frame", xlabel="column, px", ylabel="row, px")


def show_field(
    axes: Axes, grid: Grid, heatmap: npt.NDArray[Any] | None, truth: Contacts, max_depth: float
) -> Any:
    """Draw a heatmap, or an empty field, with the truth on it.

    Args:
        axes: Panel to draw on.
        grid: Grid of the heatmap.
        heatmap: (rows, columns) of the grid in 0..1; None: an empty field.
        truth: The true contacts.
        max_depth: Depth that a heatmap value of 1 stands for, mm.

    Returns:
        The image for a colour bar, None without a heatmap.
    """
    shown = None
    if heatmap is None:
        axes.set_facecolor(EMPTY_FIELD)
    else:
        shown = axes.imshow(
            heatmap * max_depth,
            cmap=HEAT,
            vmin=0,
            vmax=max_depth,
            extent=extent(grid),
            interpolation="nearest",
        )
    ink, contour = field_inks(heatmap)
    rings(axes, truth, ink, contour=contour)
    millimetres(axes, grid)
    return shown


def field_inks(heatmap: npt.NDArray[Any] | None) -> tuple[str, str]:
    """Return the colours of lines and of their contours on a heatmap or an empty field."""
    return (BLACK, "white") if heatmap is None else ("white", "black")


def outline(colour: str = "black") -> list[Any]:
    """Return a thin contour that keeps a mark visible on light and dark cells."""
    return [withStroke(linewidth=2.6, foreground=colour)]


def extent(grid: Grid) -> tuple[float, float, float, float]:
    """Return left, right, bottom, top of the outermost cell borders, mm; y runs downwards."""
    x, y = grid.axes()
    half = grid.pitch / 2
    return x[0] - half, x[-1] + half, y[-1] + half, y[0] - half


def millimetres(axes: Axes, grid: Grid) -> None:
    """Set the limits of the axes to the grid, with equal scales and labels in mm."""
    left, right, bottom, top = extent(grid)
    axes.set(xlim=(left, right), ylim=(bottom, top), xlabel="x, mm", ylabel="y, mm", aspect="equal")


def rings(axes: Axes, truth: Contacts, colour: str = "white", *, contour: str = "black") -> None:
    """Draw a circle of the tip's radius at every true contact, with its depth outside."""
    effects = outline(contour)
    for xy, depth, side in zip(truth.xy, truth.depth, _sides(truth.xy), strict=True):
        ring = Circle(
            tuple(xy),
            TIP_RADIUS_MM,
            fill=False,
            edgecolor=colour,
            linewidth=1.5,
            path_effects=effects,
        )
        axes.add_patch(ring)
        _number(axes, xy + side * (TIP_RADIUS_MM + 1.2), depth, colour, contour)


def marks(
    axes: Axes, contacts: Contacts, colour: str, marker: str = "x", *, contour: str = "black"
) -> None:
    """Draw a mark at every predicted contact."""
    axes.plot(
        *contacts.xy.T,
        linestyle="none",
        marker=marker,
        color=colour,
        markersize=8,
        markeredgewidth=1.8,
        path_effects=outline(contour),
    )


def depths(axes: Axes, contacts: Contacts, colour: str, *, contour: str, dy: float = 1.9) -> None:
    """Write the depth of every contact, mm, ``dy`` mm below its mark."""
    for xy, depth in zip(contacts.xy, contacts.depth, strict=True):
        _number(axes, np.add(xy, (0.0, dy)), depth, colour, contour)


def _number(axes: Axes, place: FloatArray, depth: float, colour: str, contour: str) -> None:
    axes.text(
        place[0],
        place[1],
        f"{depth:.1f}",
        color=colour,
        fontsize=8.5,
        ha="center",
        va="center",
        clip_on=True,
        path_effects=outline(contour),
    )


def _sides(xy: FloatArray) -> FloatArray:
    """Return (N, 2) unit vectors from the middle of all contacts to each: labels go outwards.

    A contact in the middle has a vector that points up.
    """
    away = xy - xy.mean(axis=0) if len(xy) else xy
    length = np.linalg.norm(away, axis=1, keepdims=True)
    return np.where(length > 1e-9, away / np.maximum(length, 1e-9), [[0.0, -1.0]])
