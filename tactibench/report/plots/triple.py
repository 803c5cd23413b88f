"""Several models on one press of three tips: number, places and depths of their contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy.typing as npt
from matplotlib.figure import Figure

from tactibench.contacts import Contacts, Grid
from tactibench.report.plots.marks import depths, field_inks, marks, millimetres, rings, show_field
from tactibench.report.plots.style import (
    BLACK,
    headline,
    legend_below,
    legend_mark,
    new_figure,
    row_looks,
    short_label,
)

LETTERS = 30
"""Longest line of a label above its panel."""


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
