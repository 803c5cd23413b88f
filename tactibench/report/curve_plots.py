"""Curves and heat maps of many rows: learning curves, and errors over graded hard cases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator, StrMethodFormatter

from tactibench.board import Curve, FamilyErrors, Row, counts, family_errors
from tactibench.protocols import Axis, Ranking
from tactibench.report.style import (
    GREY,
    Look,
    error_bars,
    headline,
    in_own_style,
    legend_below,
    log_ticks,
    new_figure,
    plain,
    row_looks,
    short_label,
)

CURVE_DODGE = 0.012
"""Distance between the curves, as a share of the presses, so that bars do not overlap."""
COLUMNS = 3
DODGE = 0.07
"""Distance between the rows, in steps of the axis, so that bars do not overlap."""
TENTH = 0.1
"""Share of missed contacts from which a marker is hollow."""
STABILITY_TITLE = "Hard cases: error from the easy case on"


@dataclass(frozen=True)
class Caption:
    """Title and horizontal axis of learning curves.

    Attributes:
        title: Title of the picture.
        presses: Name of the horizontal axis.
    """

    title: str
    presses: str


LEARNING = Caption(
    "Learning curve; bars: 95 % over presses, mean of the seeds",
    "presses that the model learned from",
)
NEW_SENSOR = Caption(
    "What a new sensor costs; mean over instances, bars: the best and the worst",
    "labelled presses of the new sensor",
)


@in_own_style
def curve_figure(
    curves: Sequence[Curve], error: Ranking, caption: Caption = LEARNING, *, measured_on: str = ""
) -> Figure:
    """Draw every curve with its bars, on logarithmic axes.

    Where a curve has a step with no presses, the axis is linear up to half the fewest other
    presses.

    Args:
        curves: Learning curves.
        error: Error on the vertical axis.
        caption: Title and name of the horizontal axis.
        measured_on: Printed as subtitle.
    """
    figure = new_figure(8.0, 5.2)
    axes = figure.subplots()
    middle = (len(curves) - 1) / 2
    drawn = counts(curves)
    # A logarithmic axis has no place for 0, so it is linear below half the fewest presses.
    few = min(filter(None, drawn), default=2) / 2 if 0 in drawn else 0.0
    looks = row_looks([curve.model for curve in curves])
    for k, (curve, look) in enumerate(zip(curves, looks, strict=True)):
        points = [(step.presses, step.error) for step in curve.steps if step.error is not None]
        y = [pooled.value for _, pooled in points]
        axes.errorbar(
            [presses + max(presses, few) * CURVE_DODGE * (k - middle) for presses, _ in points],
            y,
            error_bars(
                y, [pooled.low for _, pooled in points], [pooled.high for _, pooled in points]
            ),
            **look.points,
            linestyle=look.line,
            markersize=5.5,
            linewidth=1.5,
            elinewidth=1.1,
            capsize=2.5,
            label=short_label(curve.label),
        )
    axes.set(yscale="log", xlabel=caption.presses, ylabel=f"{error.name}, {error.unit}")
    if few:
        axes.set_xscale("symlog", linthresh=few, linscale=0.5)
        axes.set_xlim(-few / 2, 1.2 * max(drawn))
    else:
        axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator(drawn or [1000]))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes.xaxis.set_minor_locator(NullLocator())
    log_ticks(axes.yaxis, subs=(1, 2, 3, 5))
    plain(axes)
    if curves:
        legend_below(figure, 2)
    headline(figure, caption.title, measured_on)
    return figure


@in_own_style
def stability_figure(
    rows: Sequence[Row],
    axes: Sequence[Axis],
    *,
    title: str = STABILITY_TITLE,
    measured_on: str = "",
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
