"""Learning curves: error against training presses, both logarithmic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

from tactibench.board import Curve, counts
from tactibench.protocols import Ranking
from tactibench.report.plots.style import (
    error_bars,
    headline,
    legend_below,
    log_ticks,
    new_figure,
    plain,
    row_looks,
    short_label,
)

DODGE = 0.012
"""Distance between the curves, as a share of the presses, so that bars do not overlap."""


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
            [presses + max(presses, few) * DODGE * (k - middle) for presses, _ in points],
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
