"""Contacts drawn in millimetres: truth as rings, predictions as marks, both with their depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from tactibench.board.figures.style import HEAT
from tactibench.contacts import Contacts, FloatArray, Grid

TIP_RADIUS_MM = 3.0


def outline(colour: str = "black") -> list[Any]:
    """A thin contour that keeps a mark visible on light and dark cells."""
    return [withStroke(linewidth=2.6, foreground=colour)]


def extent(grid: Grid) -> tuple[float, float, float, float]:
    """Left, right, bottom, top of the grid's outermost cell borders, mm; y runs downwards."""
    x, y = grid.axes()
    half = grid.pitch / 2
    return x[0] - half, x[-1] + half, y[-1] + half, y[0] - half


def heat(axes: Axes, grid: Grid, heatmap: Any, max_depth: float) -> Any:
    """Draw (H, W) 0..1 as millimetres on the grid; return the image for a colour bar."""
    return axes.imshow(
        heatmap * max_depth,
        cmap=HEAT,
        vmin=0,
        vmax=max_depth,
        extent=extent(grid),
        interpolation="nearest",
    )


def millimetres(axes: Axes, grid: Grid) -> None:
    """Frame the grid with equal scales and labels in mm."""
    left, right, bottom, top = extent(grid)
    axes.set(xlim=(left, right), ylim=(bottom, top), xlabel="x, mm", ylabel="y, mm", aspect="equal")


def rings(axes: Axes, truth: Contacts, colour: str = "white", *, contour: str = "black") -> None:
    """One circle of the tip's radius at every true contact, its depth written outside it."""
    for xy, depth, side in zip(truth.xy, truth.depth, _sides(truth.xy), strict=True):
        axes.add_patch(
            Circle(
                tuple(xy),
                TIP_RADIUS_MM,
                fill=False,
                edgecolor=colour,
                linewidth=1.5,
                path_effects=outline(contour),
            )
        )
        place = xy + side * (TIP_RADIUS_MM + 1.2)
        _number(axes, place, depth, colour, contour)


def tip_outline(middle: FloatArray) -> FloatArray:
    """(49, 2) mm on the circle of the tip's radius around a contact."""
    turn = np.linspace(0, 2 * np.pi, 49)
    return middle + TIP_RADIUS_MM * np.column_stack([np.cos(turn), np.sin(turn)])


def marks(
    axes: Axes, contacts: Contacts, colour: str, marker: str = "x", *, contour: str = "black"
) -> None:
    """One mark at every predicted contact."""
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
    """Write every contact's depth, mm, ``dy`` mm below its mark."""
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


def _sides(xy: Any) -> Any:
    """(N, 2) unit vector from the middle of all contacts to each: labels go outwards.

    Up for a contact that is the middle.
    """
    away = xy - xy.mean(axis=0) if len(xy) else xy
    length = np.linalg.norm(away, axis=1, keepdims=True)
    return np.where(length > 1e-9, away / np.maximum(length, 1e-9), [[0.0, -1.0]])
