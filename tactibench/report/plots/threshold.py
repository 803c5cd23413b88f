"""Two-point discrimination: the penalised error, and the fit behind the two-point threshold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from scipy.special import expit

from tactibench.board.rows import PooledMetric, Row
from tactibench.contacts import FloatArray
from tactibench.metrics.threshold import Profile
from tactibench.records.record import Record
from tactibench.report.plots.distance import (
    Series,
    distance_series,
    dodged,
    finish,
    share_axis,
    show_line,
)
from tactibench.report.plots.style import GREY, Look, new_figure, short_label

CURVE_POINTS = 56
"""Distances at which a fitted curve is drawn."""
TITLE = "Pairs seen as two; large mark: the threshold, at which 75 % are resolved"


@dataclass(frozen=True, eq=False)
class FittedSeries(Series):
    """A row of exp2 by distance with its threshold.

    Attributes:
        fit: (2, M) distance and share of the logistic fit; None where a seed has none.
        threshold: Distance at which 75 % are resolved, mm.
    """

    fit: FloatArray | None = None
    threshold: PooledMetric | None = None


def fitted_series(row: Row) -> FittedSeries:
    """Return what a row measured by distance, with the mean of the logistic fits of its seeds."""
    series = distance_series(row)
    fit = None
    if len(series.resolved) > 1:
        distance = np.linspace(series.resolved[0, 0], series.resolved[-1, 0], CURVE_POINTS)
        fits = [logistic_fit(record, distance) for record in row.records]
        known = [one for one in fits if one is not None]
        fit = np.stack([distance, np.mean(known, axis=0)]) if len(known) == len(fits) else None
    return FittedSeries(**vars(series), fit=fit, threshold=row.metric("threshold_mm", "all"))


def logistic_fit(record: Record, distance: FloatArray) -> FloatArray | None:
    """Return (N,) the logistic fit of a run at distances, mm, from its counts and threshold.

    The slope is the most likely one at the threshold, as in ``tactibench.metrics.threshold``.

    Returns:
        None where the run has no threshold, or a bound: no fit of these counts crosses 75 % there.
    """
    shares = [m for m in record.metrics if m.metric == "resolved" and m.group[:1].isdigit()]
    known = sorted((float(m.group), m.value, m.n) for m in shares if m.value is not None)
    threshold = next((m for m in record.metrics if m.metric == "threshold_mm"), None)
    if len(known) < 2 or threshold is None or threshold.value is None or threshold.censored:
        return None
    tested, share, trials = np.array(known, dtype=np.float64).T
    middle = np.array([threshold.value])
    slope = Profile(tested, np.rint(share * trials), trials).slope(middle)
    return np.asarray(expit(Profile(distance, distance, distance).logit(middle, slope))[0])


def threshold_figure(series: Sequence[FittedSeries], *, measured_on: str = "") -> Figure:
    """Draw the penalised error, and the share seen as two with its fit and threshold.

    The fit is the mean of the seeds' fits; where a seed has none, the points are joined.
    """
    figure = new_figure(8.0, 7.2)
    errors, shares = figure.subplots(2, 1, sharex=True)
    for one, look, shift in dodged(series):
        show_line(errors, one.penalised, shift, look, short_label(one.label))
        points = one.resolved * [1, 100, 100, 100]
        if one.fit is None:
            show_line(shares, points, shift, look)
        else:
            show_line(shares, points, shift, Look(look.color, look.marker, "none"))
            shares.plot(one.fit[0], 100 * one.fit[1], color=look.color, linestyle=look.line)
        if one.threshold is not None and not one.threshold.censored:
            shares.plot(one.threshold.value, 75, markersize=11, **look.points)
    shares.axhline(75, color=GREY, linestyle=(0, (5, 3)), linewidth=1.2, zorder=1)
    errors.set_ylim(bottom=0)
    errors.set_ylabel("penalised error\nof the distance, mm")
    share_axis(shares)
    finish(figure, (errors, shares), TITLE, series, measured_on)
    return figure
