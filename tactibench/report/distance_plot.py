"""Two-point discrimination: error against distance, and the share of pairs that are seen as two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from scipy.special import expit

from tactibench.board import PooledMetric, Row
from tactibench.contacts import FloatArray
from tactibench.metrics import Profile
from tactibench.protocols import PublishedTable, published_means
from tactibench.records import Record
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
    spread,
)

DODGE_MM = 0.05
"""Distance between the series, so that interval bars do not overlap."""
FEW = 0.5
"""Share of resolved pairs below which a mark is hollow: its error is that of few pairs."""
CURVE_POINTS = 56
"""Distances at which a fitted curve is drawn."""


@dataclass(frozen=True, eq=False)
class Series:
    """A row of exp2 by distance.

    Each metric is a (K, 4) array of distance, value, low and high, ascending by distance.

    Attributes:
        label: Label of the row.
        model: Name of the model.
        error: Error over resolved pairs, mm.
        resolved: Share of pairs resolved.
        fit: (2, M) distance and share of the logistic fit; None where a seed has none.
        threshold: Distance at which 75 % are resolved, mm.
    """

    label: str
    model: str
    error: FloatArray
    resolved: FloatArray
    fit: FloatArray | None = None
    threshold: PooledMetric | None = None

    @property
    def few(self) -> npt.NDArray[np.bool_]:
        """(K,) whether fewer than half of the pairs behind each error were resolved."""
        few = set(self.resolved[self.resolved[:, 1] < FEW, 0])
        return np.array([distance in few for distance in self.error[:, 0]], dtype=bool)


def distance_series(row: Row) -> Series:
    """Return the metrics of a row by distance, with the mean of the logistic fits of its seeds."""
    resolved, fit = by_distance(row, "resolved"), None
    if len(resolved) > 1:
        distance = np.linspace(resolved[0, 0], resolved[-1, 0], CURVE_POINTS)
        fits = [logistic_fit(record, distance) for record in row.records]
        curves = [curve for curve in fits if curve is not None]
        fit = np.stack([distance, np.mean(curves, axis=0)]) if len(curves) == len(fits) else None
    return Series(
        row.label,
        row.first.model.name,
        by_distance(row, "distance_mae_mm"),
        resolved,
        fit,
        row.metric("threshold_mm", "all"),
    )


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

    The line of the shares is the mean of the logistic fits of the seeds, with a large mark at the
    threshold of 75 %; where a seed has no fit, the points are joined.

    Args:
        series: Rows in the order of the legend.
        published: Tables whose mean distance errors become dashed lines.
        measured_on: Printed as subtitle, such as "simulated sensor tactip-127".
    """
    figure = new_figure(8.0, 7.0)
    errors, shares = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    for line, look, shift in dodged(series):
        label = short_label(line.label)
        label += "" if len(line.error) else ": no pair resolved"
        show_line(errors, line.error, shift, look, label, hollow=line.few)
        points = line.resolved * [1, 100, 100, 100]
        joined = look if line.fit is None else Look(look.color, look.marker, "none")
        show_line(shares, points, shift, joined)
        if line.fit is not None:
            shares.plot(line.fit[0], 100 * line.fit[1], color=look.color, linestyle=look.line)
        if line.threshold is not None and not line.threshold.censored:
            shares.plot(line.threshold.value, 75, markersize=11, **look.points)
    shares.axhline(75, color=GREY, linestyle=(0, (5, 3)), linewidth=1.2, zorder=1)
    means = published_means(published)
    _log_errors(errors, [line.error for line in series], [value for _, value in means])
    _show_published(errors, means)
    errors.set_ylabel("error of the distance, mm\n(mean over resolved pairs)")
    shares.set(ylim=(-6, 106), yticks=[0, 25, 50, 75, 100], ylabel="pairs resolved\nas two, %")
    shares.set_xlabel("true distance of the two tips, mm")
    shares.xaxis.set_major_locator(MultipleLocator(1.0))
    for axes in (errors, shares):
        plain(axes)
    if series:
        legend_below(figure, min(3, len(series)), *errors.get_legend_handles_labels())
    few = any(line.few.any() for line in series)
    hollow = "hollow: less than half resolved" if few else ""
    title = "Two-point discrimination; large mark: the threshold, at which 75 % are resolved"
    headline(figure, title, measured_on, "bars: 95 % interval over presses", hollow)
    return figure


def logistic_fit(record: Record, distance: FloatArray) -> FloatArray | None:
    """Return the logistic fit of a run at distances, from its counts and threshold.

    The slope is the most likely one at the threshold, as in ``tactibench.metrics.threshold``.

    Args:
        record: Record of the run.
        distance: (N,) distances, mm.

    Returns:
        (N,) shares. None where the run has no threshold, or its threshold is a bound or was read
        between measured shares: no fit of these counts crosses 75 % there.
    """
    shares = [m for m in record.metrics if m.metric == "resolved" and m.group[:1].isdigit()]
    counts = sorted((float(m.group), m.value, m.n) for m in shares if m.value is not None)
    threshold = next((m for m in record.metrics if m.metric == "threshold_mm"), None)
    if len(counts) < 2 or threshold is None or threshold.value is None or threshold.censored:
        return None
    if threshold.method is not None:
        return None
    lapse = record.value("threshold_lapse", "all") or 0.0
    tested, share, trials = np.array(counts, dtype=np.float64).T
    middle = np.array([threshold.value])
    slope = Profile(tested, np.rint(share * trials), trials).slope(middle, lapse)
    eta = Profile(distance, distance, distance).logit(middle, slope, lapse)
    return np.asarray((1 - lapse) * expit(eta)[0])


def dodged(series: Sequence[Series]) -> list[tuple[Series, Look, float]]:
    """Return every series with its look and its shift along the axis, mm."""
    middle = (len(series) - 1) / 2
    looks = row_looks([line.model for line in series])
    return [
        (line, look, (k - middle) * DODGE_MM)
        for k, (line, look) in enumerate(zip(series, looks, strict=True))
    ]


def show_line(
    axes: Axes, table: FloatArray, shift: float, look: Look, label: str = "", hollow: Any = None
) -> None:
    """Draw a series as a line with bars.

    Args:
        axes: Panel to draw on.
        table: (K, 4) distance, value, low, high.
        shift: Shift along the horizontal axis, mm.
        look: Colour, marker and line.
        label: Label in the legend; "" for none.
        hollow: (K,) bool, which marks are hollow; None: none.
    """
    x, value, low, high = table.T
    axes.plot(
        x + shift,
        value,
        linestyle=look.line,
        linewidth=1.6,
        markersize=5.5,
        label=label,
        **look.points,
    )
    axes.errorbar(
        x + shift,
        value,
        error_bars(value.tolist(), low.tolist(), high.tolist()),
        fmt="none",
        capsize=2.5,
        elinewidth=1.1,
        ecolor=look.color,
    )
    if hollow is not None and hollow.any():
        few: dict[str, Any] = {"markersize": 5.5, "markerfacecolor": "white", "zorder": 3}
        axes.plot(x[hollow] + shift, value[hollow], linestyle="none", **few, **look.points)


def _log_errors(axes: Axes, tables: Sequence[FloatArray], others: Sequence[float] = ()) -> None:
    """Set a logarithmic axis of errors, because the errors of the models span decades.

    Args:
        axes: Axes of the panel.
        tables: (K, 4) distance, value, low, high, mm.
        others: More values that the axis has to show, mm.
    """
    values = [float(v) for v in (*(v for table in tables for v in table[:, 1]), *others) if v > 0]
    if values:
        high = max([*values, *(float(table[:, 3].max(initial=0.0)) for table in tables)])
        axes.set(yscale="log", ylim=(min(values) / 1.5, high * 1.3))
        log_ticks(axes.yaxis)


def _show_published(axes: Axes, means: Sequence[tuple[str, float]]) -> None:
    """Draw dashed lines, each with its name in the right margin."""
    low, high = np.log(axes.get_ylim()) if means else (0.0, 1.0)
    places = spread([float(np.log(value)) for _, value in means], (high - low) * 0.13)
    for (label, value), place in zip(means, np.exp(places), strict=True):
        axes.axhline(value, color=GREY, linestyle=(0, (5, 3)), linewidth=1.2, zorder=1)
        axes.annotate(
            f"{short_label(label)} {value:g} mm\nhardware, published",
            (1, value),
            (1.02, place),
            xycoords=("axes fraction", "data"),
            textcoords=("axes fraction", "data"),
            va="center",
            fontsize=8,
            color=GREY,
            annotation_clip=False,
        )
