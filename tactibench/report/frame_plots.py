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
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from tactibench.contacts import Contacts, FloatArray, Grid
from tactibench.report.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    HEAT,
    ORANGE,
    VERMILION,
    headline,
    in_own_style,
    legend_below,
    legend_mark,
    new_figure,
    plain,
    row_looks,
    short_label,
)

TIP_RADIUS_MM = 3.0
EMPTY_FIELD = "#F2F2F2"
"""Background of a panel of a model without heatmaps."""
AXES = (("x", BLUE), ("y", VERMILION), ("z (depth)", GREEN))
LETTERS = 30
"""Longest line of a label above its panel."""


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


@in_own_style
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


@in_own_style
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


@in_own_style
def single_figure(
    truth: npt.ArrayLike, predicted: npt.ArrayLike, *, title: str = "", measured_on: str = ""
) -> Figure:
    """Draw true and predicted x, y, depth: scatter plots above, histograms of errors below.

    The histograms share one range, the 99.5th percentile of all absolute errors rounded up, so
    that axes can be compared by eye; errors outside are counted in the panel.

    Args:
        truth: (N, 3) true x, y, depth, mm.
        predicted: (N, 3) predicted x, y, depth, mm.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    true, estimate = (np.asarray(v, dtype=np.float64).reshape(-1, 3) for v in (truth, predicted))
    error = estimate - true
    edge = histogram_edge(error)
    figure = new_figure(9.0, 5.8)
    panels = figure.subplots(2, 3, height_ratios=[3, 2])
    for k, (name, colour) in enumerate(AXES):
        scatter, histogram = panels[0, k], panels[1, k]
        ends = _ends(true[:, k], estimate[:, k])
        scatter.plot(ends, ends, color=GREY, linewidth=1, zorder=1)
        scatter.plot(true[:, k], estimate[:, k], ".", color=colour, markersize=3, alpha=0.6)
        scatter.set(
            xlim=ends,
            ylim=ends,
            aspect="equal",
            xlabel=f"true {name}, mm",
            ylabel=f"predicted {name}, mm",
        )
        scatter.set_xticks(scatter.get_yticks())
        scatter.set(xlim=ends, ylim=ends)
        histogram.hist(error[:, k], bins=np.linspace(-edge, edge, 41).tolist(), color=colour)
        histogram.axvline(0, color=GREY, linewidth=1)
        histogram.set(xlim=(-edge, edge), xlabel=f"error of {name}, mm")
        outside = int((np.abs(error[:, k]) > edge).sum())
        mae = np.abs(error[:, k]).mean() if len(error) else float("nan")
        note = f"MAE {mae:.4f} mm" + (f"\n{outside} outside" if outside else "")
        histogram.set_title(note if len(error) else "no predictions", fontsize=9)
        for axes in (scatter, histogram):
            plain(axes)
    panels[1, 0].set_ylabel("presses")
    headline(figure, title, measured_on, f"{len(true):,} presses")
    return figure


def histogram_edge(error: npt.NDArray[np.float64]) -> float:
    """Return the 99.5th percentile of |error|, mm, rounded up to one significant digit."""
    if not error.size or not np.abs(error).max() > 0:
        return 0.1
    edge = float(np.quantile(np.abs(error), 0.995)) or float(np.abs(error).max())
    unit = 10.0 ** np.floor(np.log10(edge))
    return float(np.ceil(edge / unit * (1 - 1e-9)) * unit)


def _ends(*values: npt.NDArray[np.float64]) -> tuple[float, float]:
    every = np.concatenate(values)
    if not len(every):
        return 0.0, 1.0
    margin = 0.04 * max(float(np.ptp(every)), 1e-3)
    return float(every.min()) - margin, float(every.max()) + margin


@dataclass(frozen=True, eq=False)
class Prediction:
    """The contacts of one model.

    Attributes:
        label: Label of the row.
        model: Name of the model.
        contacts: Predicted contacts.
        heatmap: (H, W) in 0..1; None for a model without heatmaps.
    """

    label: str
    model: str
    contacts: Contacts
    heatmap: npt.NDArray[Any] | None


@in_own_style
def triple_figure(
    grid: Grid,
    truth: Contacts,
    predictions: Sequence[Prediction],
    *,
    max_depth: float = 6.0,
    title: str = "",
    measured_on: str = "",
) -> Figure:
    """Draw a panel for every model, and a last one with all models and the truth.

    True contacts are rings of the tip's radius; numbers are depths, mm.

    Args:
        grid: Grid of the heatmaps.
        truth: The true contacts.
        predictions: Contacts of every model.
        max_depth: Depth that a heatmap value of 1 stands for, mm.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    count = len(predictions) + 1
    figure = new_figure(3.0 * count + 0.7, 4.5)
    panels = list(figure.subplots(1, count, sharex=True, sharey=True, squeeze=False)[0])
    looks = row_looks([prediction.model for prediction in predictions])
    together = panels[-1]
    rings(together, truth, BLACK, contour="white")
    together.set_title("all models and the truth", fontsize=9)
    millimetres(together, grid)
    shown = None
    for axes, predicted, look in zip(panels, predictions, looks, strict=False):
        shown = show_field(axes, grid, predicted.heatmap, truth, max_depth) or shown
        ink, contour = field_inks(predicted.heatmap)
        for place in (axes, together):
            marks(place, predicted.contacts, look.color, look.marker, contour="white")
        depths(axes, predicted.contacts, ink, contour=contour)
        counts = f"{len(predicted.contacts)} predicted, {len(truth)} true"
        axes.set_title(f"{fill(short_label(predicted.label), LETTERS)}\n{counts}", fontsize=9)
    for axes in panels:
        axes.label_outer()
    if shown is not None:
        figure.colorbar(shown, ax=panels, label="heatmap, mm", shrink=0.8)
    ring = {"marker": "o", "markersize": 11, "markerfacecolor": "none", "color": BLACK}
    handles = [legend_mark("truth", **ring)]
    for predicted, look in zip(predictions, looks, strict=True):
        handles.append(legend_mark(short_label(predicted.label), markersize=8, **look.points))
    legend_below(figure, min(3, count), handles)
    headline(figure, title, measured_on, "numbers are depths in mm")
    return figure
