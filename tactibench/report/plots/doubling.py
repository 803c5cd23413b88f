"""A heat map of families by models: the case at which an error is twice that of the easy one."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tactibench.board import FamilyErrors, Row, family_errors
from tactibench.protocols import Axis
from tactibench.report.hard_cases import doubling_number, family_head
from tactibench.report.plots.style import GREY, HEAT, headline, model_look, new_figure, short_label

CELL_INCH = (0.86, 0.27)
FAMILY_INCH = 2.3
"""Width beside the cells, for the name of a family and its values."""
BRIGHT = 0.55
"""Place in the colour scale, 0 to 1, above which words in a cell are dark."""
TITLE = "Value at which the error is twice that of the easy case; >, <: not doubled at the hardest"


def doubling_figure(
    rows: Sequence[Row], axes: Sequence[Axis], *, title: str = TITLE, measured_on: str = ""
) -> Figure:
    """Draw a cell for every family and model: the value at which the error doubles.

    The colour says how far along the cases of its family that value is, because families have
    different units. A white cell has no such value, because the easy case costs half the gate
    already.

    Args:
        rows: The models, one column each.
        axes: Axes of the families; those without an order are left out.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    ordered = [axis for axis in axes if axis.ordered]
    columns = [family_errors(row, ordered) for row in rows]
    size = CELL_INCH[0] * max(len(rows), 3) + FAMILY_INCH, CELL_INCH[1] * len(ordered) + 1.9
    figure = new_figure(*size)
    panel = figure.subplots()
    colours = mpl.colormaps[HEAT]
    for x, grades in enumerate(columns):
        for y, grade in enumerate(grades):
            _show_cell(panel, x, y, grade, colours)
    for x, row in enumerate(rows):
        _show_model(panel, x, row)
    heads = [f"{family_head(axis)}: {axis.easy:g} → {axis.values[-1]:g}" for axis in ordered]
    panel.set_yticks(np.arange(len(ordered)) + 0.5, heads, fontsize=8.5)
    panel.set(xlim=(0, max(len(rows), 1)), ylim=(len(ordered), 0))
    panel.set_xticks([])
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)
    bar = figure.colorbar(
        mpl.cm.ScalarMappable(mpl.colors.Normalize(0, 1), HEAT),
        ax=panel,
        location="bottom",
        aspect=11 * max(len(rows), 3),
        pad=0.02,
        ticks=[0, 1],
    )
    bar.ax.set_xticklabels(["doubled at once", "not doubled at the hardest case"], fontsize=8.5)
    left, right = bar.ax.get_xticklabels()
    left.set_horizontalalignment("left")
    right.set_horizontalalignment("right")
    bar.outline.set_visible(False)
    headline(figure, title, measured_on)
    return figure


def share_of_cases(grade: FamilyErrors) -> float | None:
    """Return how far along the cases of a family the error doubles, 0 to 1; None: unknown."""
    doubles = grade.doubles
    if doubles is None:
        return None
    if doubles.censored:
        return 1.0
    values = [case.value for case in grade.cases]
    order = np.argsort(values)  # a family may get harder as its value falls
    steps = np.arange(len(values)) / (len(values) - 1)
    return float(np.interp(doubles.value, np.array(values)[order], steps[order]))


def _show_cell(
    panel: Axes, x: int, y: int, grade: FamilyErrors, colours: mpl.colors.Colormap
) -> None:
    share, number = share_of_cases(grade), doubling_number(grade.doubles)
    if share is None or number is None:
        panel.text(x + 0.5, y + 0.5, "n/a", ha="center", va="center", fontsize=8, color=GREY)
        return
    panel.add_patch(
        Rectangle((x, y), 1, 1, facecolor=colours(share), edgecolor="white", linewidth=1.2)
    )
    ink = "black" if share > BRIGHT else "white"
    panel.text(x + 0.5, y + 0.5, number.text, ha="center", va="center", fontsize=8.5, color=ink)


def _show_model(panel: Axes, x: int, row: Row) -> None:
    """Write the name of a model above its column, with its mark."""
    name = short_label(row.label).replace(" (", "\n(").replace(" + ", "\n+ ").replace(", ", ",\n")
    transform = panel.get_xaxis_transform()
    lines = name.count("\n") + 1
    panel.plot(
        [x + 0.5],
        [1.025],
        transform=transform,
        clip_on=False,
        linestyle="none",
        markersize=6,
        **model_look(row.first.model.name).points,
    )
    panel.annotate(
        name,
        (x + 0.5, 1.0),
        (0, 17),
        xycoords=transform,
        textcoords="offset points",
        ha="center",
        va="bottom",
        fontsize=8.5 if lines < 4 else 7.5,
        annotation_clip=False,
    )
