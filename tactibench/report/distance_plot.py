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

from tactibench.board import PooledMetric, Row
from tactibench.contacts import FloatArray
from tactibench.protocols import PublishedTable, published_means
from tactibench.report.style import (
    DASHES,
    GREY,
    Look,
    headline,
    in_own_style,
    legend_below,
    log_ticks,
    new_figure,
    plain,
    row_looks,
    short_label,
)

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
    tables = (by_distance(row, metric) for metric in ("distance_mae_mm", "resolved"))
    return Series(row.label, row.first.model.name, *tables, row.metric("threshold_mm", "all"))


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
