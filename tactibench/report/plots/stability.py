"""Error against the graded value of every family of hard cases: small multiples, easy to hard."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from tactibench.board.hard_cases import FamilyErrors, family_errors
from tactibench.board.rows import Row
from tactibench.protocols.families import Axis
from tactibench.report.plots.style import (
    GREY,
    Look,
    error_bars,
    headline,
    log_ticks,
    new_figure,
    plain,
    row_looks,
    short_label,
)

COLUMNS = 4
DODGE = 0.07
"""Between the rows, in steps of the axis, so that bars stand beside each other."""
TENTH = 0.1
"""Of the contacts missed: a hollow marker."""
TITLE = "Hard cases: error from the easy case on"


def stability_figure(
    rows: Sequence[Row], axes: Sequence[Axis], *, title: str = TITLE, measured_on: str = ""
) -> Figure:
    """Draw a panel for every family with an easy case; the values are evenly spaced.

    A vertical tick on the curve marks where the error doubles.

    Args:
        rows: The models, in the order of the legend.
        axes: Of the families.
        title: Of the picture.
        measured_on: Printed as subtitle.
    """
    families = [family_errors(row, axes) for row in rows]
    looks = row_looks([row.first.model.name for row in rows])
    shown = [k for k, grade in enumerate(families[0]) if len(grade.cases) > 1]
    count = math.ceil(len(shown) / COLUMNS)
    figure = new_figure(11.0, 2.1 * count + 1.1)
    panels = np.atleast_1d(figure.subplots(count, COLUMNS)).reshape(count, COLUMNS)
    for panel, k in zip(panels.flat, shown, strict=False):
        grades = [grades[k] for grades in families]
        _show_family(panel, grades, looks, [row.label for row in rows])
    for panel in panels.flat[len(shown) :]:
        panel.set_axis_off()
    for line in panels:
        line[0].set_ylabel("error, mm", fontsize=8)
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    notes = "bars: 95 % over presses; hollow: a tenth of the contacts missed, or more; |: doubled"
    headline(figure, title, "; ".join(filter(None, (measured_on, notes))))
    return figure


def _show_family(
    axes: Axes, grades: Sequence[FamilyErrors], looks: Sequence[Look], labels: Sequence[str]
) -> None:
    axis, middle = grades[0].axis, (len(grades) - 1) / 2
    drawn = 0
    for k, (grade, look, label) in enumerate(zip(grades, looks, labels, strict=True)):
        drawn += _show_curve(axes, grade, DODGE * (k - middle), label, look)
    values = [case.value for case in grades[0].cases]
    axes.set_xticks(range(len(values)), [f"{value:g}" for value in values], fontsize=7)
    if drawn:  # an error of 0 has no place on a logarithmic axis
        axes.set_yscale("log")
        log_ticks(axes.yaxis)
        axes.yaxis.set_major_locator(LogLocator(numticks=6))
    axes.tick_params(axis="y", labelsize=7)
    unit = f", {axis.unit}" if axis.unit else ""
    axes.set_title(f"{axis.family}{unit}", fontsize=8.5, loc="left")
    plain(axes)
    axes.axvline(0.5, color=GREY, linewidth=0.6, linestyle=(0, (2, 2)))  # after the easy case


def _show_curve(axes: Axes, family: FamilyErrors, shift: float, label: str, look: Look) -> int:
    """Draw one row on one family; return how many errors were drawn."""
    known = [
        (k, case, case.error)
        for k, case in enumerate(family.cases)
        if case.error is not None and case.error.value > 0
    ]
    x = np.array([k + shift for k, _, _ in known])
    y = [error.value for _, _, error in known]
    marks: dict[str, Any] = {"markersize": 3.5, **look.points}
    axes.errorbar(
        x,
        y,
        error_bars(y, [error.low for _, _, error in known], [error.high for _, _, error in known]),
        linestyle=look.line if family.axis.ordered else "none",
        linewidth=1.1,
        elinewidth=0.8,
        capsize=1.5,
        label=short_label(label),
        **marks,
    )
    missed = [case.missed is not None and case.missed.value >= TENTH for _, case, _ in known]
    for place, value in ((a, b) for a, b, few in zip(x, y, missed, strict=True) if few):
        axes.plot(place, value, linestyle="none", markerfacecolor="white", zorder=3, **marks)
    doubles = family.doubles
    if doubles is not None and not doubles.censored and family.axis.ordered and len(known) > 1:
        place = _on_axis(doubles.value, [case.value for case in family.cases])
        tick: dict[str, Any] = {"markersize": 9, "markeredgewidth": 1.4, "color": look.color}
        height = _log_between(place, x - shift, y)
        axes.plot(place + shift, height, marker="|", linestyle="none", **tick)
    return len(known)


def _log_between(x: float, at: Any, y: Any) -> float:
    """Return the height on the straight line that a logarithmic axis shows."""
    return float(np.exp(np.interp(x, at, np.log(y))))


def _on_axis(value: float, values: Sequence[float]) -> float:
    """Return where a value lies between evenly spaced ones, rising or falling."""
    order = np.argsort(values)
    return float(np.interp(value, np.array(values)[order], np.arange(len(values))[order]))
