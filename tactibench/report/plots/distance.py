"""Two-point discrimination: error against distance, and how likely a pair is seen as two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactibench.board.rows import Row
from tactibench.contacts import FloatArray
from tactibench.protocols.published import PublishedTable, published_means
from tactibench.report.plots.style import (
    GREY,
    Look,
    error_bars,
    headline,
    new_figure,
    plain,
    row_looks,
    short_label,
    spread,
)

DODGE_MM = 0.05
"""Between the series, so that interval bars stand beside each other."""
FEW = 0.5
"""Share of resolved pairs below which an error is one of few: a hollow mark."""


@dataclass(frozen=True, eq=False)
class Series:
    """A row of exp2 by distance: (K, 4) distance, value, low, high of three metrics, ascending.

    Attributes:
        label: Of the row.
        model: Its name.
        error: mm, over resolved pairs.
        penalised: mm, an unresolved pair counts its true distance.
        resolved: Share of pairs resolved.
    """

    label: str
    model: str
    error: FloatArray
    penalised: FloatArray
    resolved: FloatArray

    @property
    def few(self) -> npt.NDArray[np.bool_]:
        """(K,) whether less than half of the pairs behind each error were resolved."""
        few = set(self.resolved[self.resolved[:, 1] < FEW, 0])
        return np.array([distance in few for distance in self.error[:, 0]], dtype=bool)


SeriesT = TypeVar("SeriesT", bound=Series)


def distance_series(row: Row) -> Series:
    """Return what a row measured by distance."""
    return Series(
        row.label,
        row.first.model.name,
        by_distance(row, "distance_mae_mm"),
        by_distance(row, "distance_penalised_mm"),
        by_distance(row, "resolved"),
    )


def by_distance(row: Row, metric: str) -> FloatArray:
    """Return (K, 4) distance, value, low, high of a metric, ascending; n/a is left out.

    A missing end of an interval is the value itself: no bar is drawn on that side.
    """
    lines = []
    for group in dict.fromkeys(m.group for m in row.first.metrics if m.metric == metric):
        pooled = row.metric(metric, group)
        if pooled is not None and group[:1].isdigit():
            ends = (pooled.value if end is None else end for end in (pooled.low, pooled.high))
            lines.append((float(group), pooled.value, *ends))
    return np.array(sorted(lines), dtype=np.float64).reshape(-1, 4)


def distance_figure(
    series: Sequence[Series],
    *,
    published: Sequence[PublishedTable] = (),
    measured_on: str = "",
) -> Figure:
    """Draw distance error against distance with intervals, and the resolved share below it.

    Args:
        series: In the order of the legend.
        published: Tables whose mean distance errors become dashed lines.
        measured_on: Printed as subtitle, such as "simulated sensor tactip-127".
    """
    figure = new_figure(8.0, 6.0)
    errors, shares = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    ceiling = 0.0
    for one, look, shift in dodged(series):
        label = short_label(one.label)
        label += "" if len(one.error) else ": no pair resolved"
        show_line(errors, one.error, shift, look, label, hollow=one.few)
        show_line(shares, one.resolved * [1, 100, 100, 100], shift, look)
        ceiling = max(ceiling, float(one.error[:, 3].max(initial=0.0)))
    means = published_means(published)
    ceiling = max([ceiling, *(value for _, value in means)]) * 1.06 or 1.0
    _show_published(errors, means, ceiling)
    errors.set_ylim(0, ceiling)
    errors.set_ylabel("error of the distance, mm\n(mean over resolved pairs)")
    share_axis(shares)
    finish(figure, (errors, shares), "Two-point discrimination", series, measured_on)
    return figure


def dodged(series: Sequence[SeriesT]) -> list[tuple[SeriesT, Look, float]]:
    """Return every series with its look, and how far it is moved aside, mm."""
    middle = (len(series) - 1) / 2
    looks = row_looks([one.model for one in series])
    return [
        (one, look, (k - middle) * DODGE_MM)
        for k, (one, look) in enumerate(zip(series, looks, strict=True))
    ]


def show_line(
    axes: Axes, table: FloatArray, shift: float, look: Look, label: str = "", hollow: Any = None
) -> None:
    """Draw (K, 4) distance, value, low, high as a line with bars; hollow: (K,) marks."""
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


def share_axis(axes: Axes) -> None:
    """Set the axes of a panel of resolved shares by distance."""
    axes.set_ylim(-6, 106)
    axes.set_yticks([0, 25, 50, 75, 100])
    axes.set_ylabel("pairs resolved\nas two, %")
    axes.set_xlabel("true distance of the two tips, mm")
    axes.set_xticks(range(6, 13))


def finish(
    figure: Figure, panels: tuple[Axes, Axes], title: str, series: Sequence[Series], where: str
) -> None:
    """Add grid, legend and headline."""
    for axes in panels:
        plain(axes)
    if series:
        handles, labels = panels[0].get_legend_handles_labels()
        columns = min(3, len(series))
        figure.legend(
            handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9
        )
    details = [where, "bars: 95 % interval over presses"]
    if title.startswith("Two-point") and any(one.few.any() for one in series):
        details.append("hollow: less than half resolved")
    headline(figure, title, "; ".join(filter(None, details)))


def _show_published(axes: Axes, means: Sequence[tuple[str, float]], ceiling: float) -> None:
    """Draw dashed lines, each named in the right margin."""
    places = spread([value for _, value in means], ceiling * 0.13)
    for (label, value), place in zip(means, places, strict=True):
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
