"""Experiment 2 as a curve: error of the distance, and how many pairs it is an error of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from tactibench.board.figures.style import (
    GREY,
    figure,
    headline,
    plain,
    save,
    series_look,
    spread,
)
from tactibench.board.published import PublishedTable, published_means
from tactibench.records.record import Metric

Rows = Sequence[Metric]
DODGE_MM = 0.05
"""Between the series, so that interval bars stand beside each other."""


def distance_errors(
    path: Path,
    series: Sequence[tuple[str, Rows]],
    *,
    published: Sequence[PublishedTable] = (),
    measured_on: str = "",
) -> None:
    """Draw distance error against distance with intervals, and the resolved share below it.

    series: (label, metric rows of a record of exp2), drawn in that order. published: tables whose
    mean distance errors become dashed lines. measured_on: printed as subtitle, such as
    "simulated sensor tactip-127". A hollow marker stands for less than half of the pairs resolved.
    """
    made = figure(8.0, 6.0)
    errors, shares = made.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    middle = (len(series) - 1) / 2
    ceiling = 0.0
    for k, (label, rows) in enumerate(series):
        shift = (k - middle) * DODGE_MM
        look = series_look(k)
        share = by_distance(rows, "resolved")
        error = by_distance(rows, "distance_mae_mm")
        name = label if len(error) else f"{label}: no pair resolved"
        ceiling = max(ceiling, _line(errors, error, shift, look, name, hollow=_rare(error, share)))
        _line(shares, share * [1, 100, 100, 100], shift, look, "")
    lines = published_means(published)
    ceiling = max([ceiling, *(value for _, value in lines)]) * 1.06 or 1.0
    _mark_published(errors, lines, ceiling)
    errors.set_ylim(0, ceiling)
    errors.set_ylabel("error of the distance, mm\n(mean over resolved pairs)")
    shares.set_ylim(-6, 106)
    shares.set_yticks([0, 50, 100])
    shares.set_ylabel("pairs resolved\nas two, %")
    shares.set_xlabel("true distance of the two tips, mm")
    shares.set_xticks(range(6, 13))
    for axes in (errors, shares):
        plain(axes)
    if series:
        made.legend(
            *errors.get_legend_handles_labels(),
            loc="outside lower center",
            ncols=min(3, len(series)),
            frameon=False,
            fontsize=9,
        )
    detail = "; ".join(filter(None, (measured_on, "bars: 95 % interval over presses")))
    if any(
        _rare(by_distance(r, "distance_mae_mm"), by_distance(r, "resolved")).any()
        for _, r in series
    ):
        detail += "; hollow: less than half resolved"
    headline(made, "Two-point discrimination", detail)
    save(made, path)


def by_distance(rows: Rows, metric: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(K, 4) distance, value, low, high of a metric, ascending; n/a is left out.

    A missing end of an interval is the value itself: no bar is drawn on that side.
    """
    found = []
    for row in rows:
        if row.metric == metric and row.group != "all" and row.value is not None:
            value = row.value
            ends = (value if end is None else end for end in (row.low, row.high))
            found.append((float(row.group), value, *ends))
    return np.array(sorted(found), dtype=np.float64).reshape(-1, 4)


def _rare(error: Any, share: Any) -> Any:
    """(K,) whether less than half of the pairs behind each error were resolved."""
    few = set(share[share[:, 1] < 0.5, 0])
    return np.array([distance in few for distance in error[:, 0]], dtype=bool)


def _line(
    axes: Axes, table: Any, shift: float, look: dict[str, Any], label: str, hollow: Any = None
) -> float:
    """Draw one series; return the top of its tallest bar."""
    x, value, low, high = table.T
    axes.plot(x + shift, value, linewidth=1.6, markersize=5.5, label=label, **look)
    axes.errorbar(
        x + shift,
        value,
        [value - low, high - value],
        fmt="none",
        capsize=2.5,
        elinewidth=1.1,
        ecolor=look["color"],
    )
    if hollow is not None and hollow.any():
        axes.plot(
            x[hollow] + shift,
            value[hollow],
            linestyle="none",
            markersize=5.5,
            markerfacecolor="white",
            zorder=3,
            **look,
        )
    return float(high.max(initial=0.0))


def _mark_published(axes: Axes, lines: Sequence[tuple[str, float]], ceiling: float) -> None:
    """Dashed lines, each named in the right margin."""
    places = spread([value for _, value in lines], ceiling * 0.13)
    for (label, value), place in zip(lines, places, strict=True):
        axes.axhline(value, color=GREY, linestyle=(0, (5, 3)), linewidth=1.2, zorder=1)
        axes.annotate(
            f"{label} {value:g} mm\nhardware, published",
            (1, value),
            (1.02, place),
            xycoords=("axes fraction", "data"),
            va="center",
            textcoords=("axes fraction", "data"),
            fontsize=8,
            color=GREY,
            annotation_clip=False,
        )
