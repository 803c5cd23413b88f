"""Hard cases: error against the graded value of every family, and one frame of every case."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from tactibench.board import FamilyErrors, Row, family_errors
from tactibench.protocols import Axis
from tactibench.report.plots.style import (
    GREY,
    Look,
    error_bars,
    headline,
    legend_below,
    log_ticks,
    new_figure,
    plain,
    row_looks,
    short_label,
)

COLUMNS = 3
DODGE = 0.07
"""Distance between the rows, in steps of the axis, so that bars do not overlap."""
TENTH = 0.1
"""Share of missed contacts from which a marker is hollow."""
TITLE = "Hard cases: error from the easy case on"
BLOCKS = 2
"""Number of families side by side: a page is wider than one row of frames."""
SHARE = 0.7
"""Share of a frame's sides, around the middle, that is shown: there are no pins outside."""


def stability_figure(
    rows: Sequence[Row], axes: Sequence[Axis], *, title: str = TITLE, measured_on: str = ""
) -> Figure:
    """Draw a panel for every family with an easy case; the values are evenly spaced.

    A vertical tick on the curve marks the value at which the error doubles.

    Args:
        rows: The models, in the order of the legend.
        axes: Axes of the families.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    families = [family_errors(row, axes) for row in rows]
    looks = row_looks([row.first.model.name for row in rows])
    shown = [k for k, grade in enumerate(families[0]) if len(grade.cases) > 1]
    count = math.ceil(len(shown) / COLUMNS)
    figure = new_figure(9.0, 2.0 * count + 1.1)
    panels = np.atleast_1d(figure.subplots(count, COLUMNS)).reshape(count, COLUMNS)
    for panel, k in zip(panels.flat, shown, strict=False):
        grades = [grades[k] for grades in families]
        _show_family(panel, grades, looks, [row.label for row in rows])
    for panel in panels.flat[len(shown) :]:
        panel.set_axis_off()
    for line in panels:
        line[0].set_ylabel("error, mm", fontsize=9)
    handles, labels = panels.flat[0].get_legend_handles_labels()
    legend_below(figure, 4, handles, labels)
    notes = "bars: 95 % over presses; hollow: a tenth of the contacts missed, or more; |: doubled"
    headline(figure, title, measured_on, notes)
    return figure


def _show_family(
    axes: Axes, grades: Sequence[FamilyErrors], looks: Sequence[Look], labels: Sequence[str]
) -> None:
    axis, middle = grades[0].axis, (len(grades) - 1) / 2
    drawn = 0
    for k, (grade, look, label) in enumerate(zip(grades, looks, labels, strict=True)):
        drawn += _show_curve(axes, grade, DODGE * (k - middle), label, look)
    values = [case.value for case in grades[0].cases]
    axes.set_xticks(range(len(values)), [f"{value:g}" for value in values], fontsize=8)
    if drawn:  # an error of 0 has no place on a logarithmic axis
        axes.set_yscale("log")
        log_ticks(axes.yaxis)
        axes.yaxis.set_major_locator(LogLocator(numticks=6))
    axes.tick_params(axis="y", labelsize=8)
    unit = f", {axis.unit}" if axis.unit else ""
    axes.set_title(f"{axis.family}{unit}", fontsize=9, loc="left")
    plain(axes)
    axes.axvline(0.5, color=GREY, linewidth=0.6, linestyle=(0, (2, 2)))  # after the easy case


def _show_curve(axes: Axes, family: FamilyErrors, shift: float, label: str, look: Look) -> int:
    """Draw one row on one family and return how many errors were drawn."""
    drawn = [
        (k, case, case.error)
        for k, case in enumerate(family.cases)
        if case.error is not None and case.error.value > 0
    ]
    x = np.array([k + shift for k, _, _ in drawn])
    y = [error.value for _, _, error in drawn]
    marks: dict[str, Any] = {"markersize": 3.5, **look.points}
    axes.errorbar(
        x,
        y,
        error_bars(y, [error.low for _, _, error in drawn], [error.high for _, _, error in drawn]),
        linestyle=look.line if family.axis.ordered else "none",
        linewidth=1.1,
        elinewidth=0.8,
        capsize=1.5,
        label=short_label(label),
        **marks,
    )
    missed = [case.missed is not None and case.missed.value >= TENTH for _, case, _ in drawn]
    for place, value in ((a, b) for a, b, few in zip(x, y, missed, strict=True) if few):
        axes.plot(place, value, linestyle="none", markerfacecolor="white", zorder=3, **marks)
    doubles = family.doubles
    if doubles is not None and not doubles.censored and family.axis.ordered and len(drawn) > 1:
        place = _on_axis(doubles.value, [case.value for case in family.cases])
        tick: dict[str, Any] = {"markersize": 9, "markeredgewidth": 1.4, "color": look.color}
        height = _log_between(place, x - shift, y)
        axes.plot(place + shift, height, marker="|", linestyle="none", **tick)
    return len(drawn)


def _log_between(x: float, at: Any, y: Any) -> float:
    """Return the height on the straight line that a logarithmic axis shows between two points."""
    return float(np.exp(np.interp(x, at, np.log(y))))


def _on_axis(value: float, values: Sequence[float]) -> float:
    """Return the place of a value between evenly spaced values, rising or falling."""
    order = np.argsort(values)
    return float(np.interp(value, np.array(values)[order], np.arange(len(values))[order]))


def case_frames_figure(
    frames: Mapping[str, npt.NDArray[Any]], axes: Sequence[Axis], *, title: str = ""
) -> Figure:
    """Draw frames cut to the pins, each under its value.

    The easy case comes first. Families without a frame are left out.

    Args:
        frames: Group -> image.
        axes: Axes of the families.
        title: Title of the picture.
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
    headline(figure, title)
    return figure


def _cases(axis: Axis) -> list[tuple[float, str]]:
    cases = list(zip(axis.values, axis.groups, strict=True))
    return cases if axis.easy is None else [(axis.easy, axis.reference), *cases]


def _cut(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    margin = [round(n * (1 - SHARE) / 2) for n in image.shape[:2]]
    return np.asarray(image[margin[0] : -margin[0] or None, margin[1] : -margin[1] or None])
