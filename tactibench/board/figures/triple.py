"""Several models on one press of three tips: who sees three, where and how deep."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy.typing as npt
from matplotlib.lines import Line2D

from tactibench.board.figures.marks import depths, heat, marks, millimetres, rings
from tactibench.board.figures.style import BLACK, figure, headline, save, series_look
from tactibench.contacts import Contacts, Grid

LETTERS = 30
"""Of a label in one line above its panel."""


def triple_comparison(
    path: Path,
    grid: Grid,
    truth: Contacts,
    models: Mapping[str, Contacts],
    heatmaps: Mapping[str, npt.NDArray[Any]],
    *,
    max_depth: float = 6.0,
    title: str = "",
    measured_on: str = "",
) -> None:
    """One panel per model, and a last one with all models and the truth.

    models: label -> predicted contacts, in the order of the panels. heatmaps: label -> (H, W) map
    in 0..1 for those models that have one; the others are drawn on an empty field. Truth is a ring
    of the tip's radius; numbers are depths, mm.
    """
    made = figure(3.0 * (len(models) + 1) + 0.7, 4.5)
    panels = list(made.subplots(1, len(models) + 1, sharex=True, sharey=True, squeeze=False)[0])
    drawn = None
    for k, (label, found) in enumerate(models.items()):
        axes, heatmap = panels[k], heatmaps.get(label)
        if heatmap is not None:
            drawn = heat(axes, grid, heatmap, max_depth)
        ink, contour = (BLACK, "white") if heatmap is None else ("white", "black")
        rings(axes, truth, ink, contour=contour)
        look = series_look(k)
        marks(axes, found, look["color"], look["marker"], contour="white")
        depths(axes, found, ink, contour=contour)
        axes.set_title(
            f"{fill(label, LETTERS)}\n{len(found)} predicted, {len(truth)} true", fontsize=9
        )
    _together(panels[-1], truth, models)
    for axes in panels:
        millimetres(axes, grid)
        axes.label_outer()
    if drawn is not None:
        made.colorbar(drawn, ax=panels, label="heatmap, mm", shrink=0.8)
    made.legend(
        handles=_legend(models),
        loc="outside lower center",
        ncols=min(3, len(models) + 1),
        frameon=False,
        fontsize=9,
    )
    headline(made, title, "; ".join(filter(None, (measured_on, "numbers are depths in mm"))))
    save(made, path)


def _together(axes: Any, truth: Contacts, models: Mapping[str, Contacts]) -> None:
    rings(axes, truth, BLACK, contour="white")
    for k, found in enumerate(models.values()):
        look = series_look(k)
        marks(axes, found, look["color"], look["marker"], contour="white")
    axes.set_title("all models and the truth", fontsize=9)


def _legend(models: Mapping[str, Contacts]) -> list[Line2D]:
    ring = Line2D(
        [],
        [],
        linestyle="none",
        marker="o",
        markersize=11,
        markerfacecolor="none",
        color=BLACK,
        label="truth",
    )
    return [ring] + [
        Line2D([], [], linestyle="none", markersize=8, label=label, **series_look(k))
        for k, label in enumerate(models)
    ]
