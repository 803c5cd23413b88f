"""Curves of many rows: over training presses, graded hard cases, and the distance of two tips."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import (
    FixedLocator,
    LogLocator,
    MultipleLocator,
    NullLocator,
    StrMethodFormatter,
)

from tactibench.board import Curve, FamilyErrors, PooledMetric, Row, counts, family_errors
from tactibench.contacts import FloatArray
from tactibench.protocols import Axis, PublishedTable, Ranking, published_means
from tactibench.report.style import (
    DASHES,
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
    notes = "bars: 95 % over presses; hollow: a tenth of the contacts missed, or more"
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
    return len(drawn)


DODGE_MM = 0.05
"""Distance between the series, so that interval bars do not overlap."""
FEW = 0.5
"""Share of resolved pairs below which a mark is hollow: its error is that of few pairs."""
MARKS: dict[str, Any] = {"markersize": 5.5}
DASHED: dict[str, Any] = {"color": GREY, "linestyle": (0, (5, 3)), "linewidth": 1.2, "zorder": 1}


@dataclass(frozen=True, eq=False)
class Series:
    """A row of exp2 by distance.

    Each metric is a (K, 4) array of distance, value, low and high, ascending by distance.

    Attributes:
        label: Label of the row.
        model: Name of the model.
        error: Error over resolved pairs, mm.
        resolved: Share of pairs resolved.
        threshold: Distance at which 75 % are resolved, mm.
    """

    label: str
    model: str
    error: FloatArray
    resolved: FloatArray
    threshold: PooledMetric | None = None

    @property
    def few(self) -> npt.NDArray[np.bool_]:
        """(K,) whether fewer than half of the pairs behind each error were resolved."""
        few = self.resolved[self.resolved[:, 1] < FEW, 0]
        return np.isin(self.error[:, 0], few)


def distance_series(row: Row) -> Series:
    """Return the metrics of a row by distance."""
    error, resolved = (by_distance(row, metric) for metric in ("distance_mae_mm", "resolved"))
    threshold = row.metric("threshold_mm", "all")
    return Series(row.label, row.first.model.name, error, resolved, threshold)


def by_distance(row: Row, metric: str) -> FloatArray:
    """Return (K, 4) distance, value, low, high of a metric, ascending; n/a is left out.

    A missing end of an interval is set to the value itself, so that no bar is drawn on that side.
    """
    lines = []
    for group in dict.fromkeys(m.group for m in row.first.metrics if m.metric == metric):
        pooled = row.metric(metric, group)
        if pooled is not None and group[:1].isdigit():
            ends = (pooled.value if end is None else end for end in (pooled.low, pooled.high))
            lines.append((float(group), pooled.value, *ends))
    return np.array(sorted(lines), dtype=np.float64).reshape(-1, 4)


@in_own_style
def distance_figure(
    series: Sequence[Series],
    *,
    published: Sequence[PublishedTable] = (),
    measured_on: str = "",
) -> Figure:
    """Draw the distance error with intervals, and below it the share of pairs resolved as two.

    A large mark stands at the threshold of 75 %, which is that of a logistic fit.

    Args:
        series: Rows in the order of the legend.
        published: Tables whose mean distance errors become dashed lines.
        measured_on: Printed as subtitle, such as "simulated sensor tactip-127".
    """
    figure = new_figure(8.0, 7.0)
    errors, shares = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    looks = row_looks([line.model for line in series])
    for k, (line, look) in enumerate(zip(series, looks, strict=True)):
        shift = DODGE_MM * (k - (len(series) - 1) / 2)
        label = short_label(line.label) + ("" if len(line.error) else ": no pair resolved")
        _show_line(errors, line.error, shift, look, label)
        hollow: dict[str, Any] = {**MARKS, "markerfacecolor": "white", "zorder": 3}
        errors.plot(
            *(line.error[line.few, :2] + [shift, 0]).T, linestyle="none", **hollow, **look.points
        )
        _show_line(shares, line.resolved * [1, 100, 100, 100], shift, look)
        if line.threshold is not None and not line.threshold.censored:
            shares.plot(line.threshold.value, 75, markersize=11, **look.points)
    shares.axhline(75, **DASHED)
    for (name, value), dash in zip(published_means(published), DASHES[1:], strict=False):
        label = f"{short_label(name)}, {value:g} mm: hardware, published"
        errors.axhline(value, **{**DASHED, "linestyle": dash}, label=label)
    if any((line.error[:, 1] > 0).any() for line in series):
        errors.set_yscale("log", nonpositive="mask")
        log_ticks(errors.yaxis)
    errors.set_ylabel("error of the distance, mm\n(mean over resolved pairs)")
    shares.set(ylim=(-6, 106), yticks=[0, 25, 50, 75, 100], ylabel="pairs resolved\nas two, %")
    shares.set_xlabel("true distance of the two tips, mm")
    shares.xaxis.set_major_locator(MultipleLocator(1.0))
    for axes in (errors, shares):
        plain(axes)
    if series:
        legend_below(figure, 2, *errors.get_legend_handles_labels())
    few = any(line.few.any() for line in series)
    hollow_note = "hollow: less than half resolved" if few else ""
    title = "Two-point discrimination; large mark: the threshold, at which 75 % are resolved"
    headline(figure, title, measured_on, "bars: 95 % interval over presses", hollow_note)
    return figure


def _show_line(axes: Axes, table: FloatArray, shift: float, look: Look, label: str = "") -> None:
    """Draw (K, 4) distance, value, low and high as a line with bars."""
    x, value, low, high = table.T
    axes.errorbar(
        x + shift,
        value,
        [value - low, high - value],
        linestyle=look.line,
        label=label,
        linewidth=1.6,
        elinewidth=1.1,
        capsize=2.5,
        **MARKS,
        **look.points,
    )
