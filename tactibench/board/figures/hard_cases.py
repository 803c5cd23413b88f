"""Error against the graded value of every family of hard cases: small multiples, easy to hard."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from tactibench.board.figures.style import GREY, figure, headline, plain, save, series_look
from tactibench.board.hard_cases import Graded

COLUMNS = 4
DODGE = 0.07
"""Between the series, in steps of the axis, so that bars stand beside each other."""
TENTH = 0.1
"""Of the contacts missed: a hollow marker."""

Series = Sequence[tuple[str, Sequence[Graded]]]
"""Label and families of every row."""


def hard_cases(path: Path, series: Series, *, title: str = "", measured_on: str = "") -> None:
    """Draw a panel for every family with an easy case; the values are evenly spaced.

    A vertical tick on the curve marks where the error doubles.
    """
    families = [k for k, one in enumerate(series[0][1]) if len(one.cases) > 1]
    count = math.ceil(len(families) / COLUMNS)
    made = figure(11.0, 2.1 * count + 1.1)
    grid = np.atleast_1d(made.subplots(count, COLUMNS)).reshape(count, COLUMNS)
    for axes, k in zip(grid.flat, families, strict=False):
        _panel(axes, k, series)
    for axes in grid.flat[len(families) :]:
        axes.set_axis_off()
    for row in grid:
        row[0].set_ylabel("error, mm", fontsize=8)
    handles, labels = grid.flat[0].get_legend_handles_labels()
    made.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    notes = "bars: 95 % over presses; hollow: a tenth of the contacts missed, or more; |: doubled"
    headline(made, title, "; ".join(filter(None, (measured_on, notes))))
    save(made, path)


def _panel(axes: Axes, k: int, series: Series) -> None:
    axis = series[0][1][k].axis
    middle, shown = (len(series) - 1) / 2, 0
    for s, (label, families) in enumerate(series):
        look = series_look(s) | {"markersize": 3.5}
        shown += _curve(axes, families[k], DODGE * (s - middle), label, look)
    values = [case.value for case in series[0][1][k].cases]
    axes.set_xticks(range(len(values)), [f"{value:g}" for value in values], fontsize=7)
    if shown:  # nothing has no place on a logarithmic axis
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(numticks=6))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis="y", labelsize=7)
    unit = f", {axis.unit}" if axis.unit else ""
    axes.set_title(f"{axis.family}{unit}", fontsize=8.5, loc="left")
    plain(axes)
    axes.axvline(0.5, color=GREY, linewidth=0.6, linestyle=(0, (2, 2)))  # after the easy case


def _curve(axes: Axes, family: Graded, shift: float, label: str, look: dict[str, Any]) -> int:
    """Draw one row on one family; return how many errors were drawn: 0 has no place there."""
    known = [
        (k, case, case.error)
        for k, case in enumerate(family.cases)
        if case.error is not None and case.error.value > 0
    ]
    x = np.array([k + shift for k, _, _ in known])
    y = np.array([error.value for _, _, error in known])
    low = [y_k - (y_k if e.low is None else e.low) for y_k, (_, _, e) in zip(y, known, strict=True)]
    high = [
        (y_k if e.high is None else e.high) - y_k for y_k, (_, _, e) in zip(y, known, strict=True)
    ]
    joined = "-" if family.axis.ordered else "none"
    axes.errorbar(
        x,
        y,
        [low, high],
        linestyle=joined,
        linewidth=1.1,
        elinewidth=0.8,
        capsize=1.5,
        label=label,
        **look,
    )
    missed = np.array(
        [case.missed is not None and case.missed.value >= TENTH for _, case, _ in known], dtype=bool
    )
    if missed.any():
        axes.plot(x[missed], y[missed], linestyle="none", markerfacecolor="white", zorder=3, **look)
    doubles = family.doubles
    if doubles is not None and not doubles.censored and family.axis.ordered and len(known) > 1:
        place = _on_axis(doubles.value, [case.value for case in family.cases])
        axes.plot(
            place + shift,
            _log_between(place, x - shift, y),
            marker="|",
            markersize=9,
            markeredgewidth=1.4,
            color=look["color"],
            linestyle="none",
        )
    return len(known)


def _log_between(x: float, at: Any, y: Any) -> float:
    """On the straight line that a logarithmic axis shows."""
    return float(np.exp(np.interp(x, at, np.log(y))))


def _on_axis(value: float, values: Sequence[float]) -> float:
    """Where a value lies between evenly spaced ones, rising or falling."""
    order = np.argsort(values)
    return float(np.interp(value, np.array(values)[order], np.arange(len(values))[order]))
