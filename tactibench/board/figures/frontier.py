"""Speed against error as a picture: every point named in the margin, the frontier as a line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from tactibench.board.figures.style import (
    GREY,
    figure,
    headline,
    plain,
    save,
    series_look,
    spread,
)
from tactibench.board.frontier import Frontier, Point

LINE_INCH = 0.19
"""Height of a label in the margin."""
FADED = 0.45


def frontier_picture(
    path: Path, found: Sequence[Frontier], *, error: str, title: str = "", measured_on: str = ""
) -> None:
    """Draw latency (log) against error (log) with intervals, one panel a regime on the same axes.

    error: name of the error with its unit. Colour and marker by model; filled: not dominated,
    hollow: dominated. Labels stand in the right margin in the order of the errors, each joined to
    its point.
    """
    most = max((len(one.points) for one in found), default=0)
    panel = max(3.6, LINE_INCH * most + 0.7)
    made = figure(9.5, panel * max(1, len(found)) + 1.3)
    panels = made.subplots(max(1, len(found)), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    every = [point for one in found for point in one.points]
    looks = _looks(every)
    if every:
        _scales(panels[0], every)
    for axes, one in zip(panels, found, strict=False):
        _panel(axes, one, looks, panel - 0.5)
    for axes in panels:
        axes.set_ylabel(error)
        plain(axes)
    panels[-1].set_xlabel("one frame to contacts, p90 on one thread, ms")
    if every:
        made.legend(
            handles=_legend(looks),
            loc="outside lower center",
            ncols=min(5, 2 + len(looks)),
            frameon=False,
            fontsize=9,
        )
    headline(made, title, measured_on)
    save(made, path)


def _panel(axes: Axes, one: Frontier, looks: dict[str, dict[str, Any]], inches: float) -> None:
    for point in one.points:
        _mark(axes, point, looks[_model(point)], hollow=point.label in one.dominated)
    _line(axes, one.best)
    _labels(axes, one, LINE_INCH / inches)
    axes.set_title(f"trained in regime {one.regime}", fontsize=10, loc="left")


def _model(point: Point) -> str:
    return str(point.row.first.model.name)


def _looks(points: Sequence[Point]) -> dict[str, dict[str, Any]]:
    models = sorted({_model(point) for point in points})
    return {model: series_look(k) for k, model in enumerate(models)}


def _mark(axes: Axes, point: Point, look: dict[str, Any], *, hollow: bool) -> None:
    x, y = point.latency, point.error
    axes.errorbar(
        x.value,
        y.value,
        [[y.value - y.low], [y.high - y.value]],
        [[x.value - x.low], [x.high - x.value]],
        fmt="none",
        ecolor=look["color"],
        elinewidth=1.1,
        alpha=FADED if hollow else 1.0,
    )
    face = "white" if hollow else look["color"]
    axes.plot(
        x.value,
        y.value,
        linestyle="none",
        markersize=7,
        markeredgewidth=1.4,
        markerfacecolor=face,
        zorder=3,
        **look,
    )


def _scales(axes: Axes, points: Sequence[Point]) -> None:
    """Logarithmic, with a margin, and numbers instead of powers."""
    for axis, ranges in (("x", [p.latency for p in points]), ("y", [p.error for p in points])):
        low = min(min(r.low for r in ranges if r.low > 0), min(r.value for r in ranges))
        high = max(r.high for r in ranges)
        margin = max((high / low) ** 0.06, 1.1)
        if axis == "x":
            axes.set(xscale="log", xlim=(low / margin, high * margin))
        else:
            axes.set(yscale="log", ylim=(low / margin, high * margin))
        shown = axes.xaxis if axis == "x" else axes.yaxis
        subs = (1, 2, 5) if high / low < 300 else (1,)
        shown.set_major_locator(LogLocator(subs=subs))
        shown.set_major_formatter(StrMethodFormatter("{x:g}"))
        shown.set_minor_formatter(NullFormatter())


def _line(axes: Axes, best: Sequence[Point]) -> None:
    """The least error that is reached within a time: steps through the best points."""
    right = axes.get_xlim()[1]
    x = [point.latency.value for point in best] + [right]
    y = [point.error.value for point in best]
    axes.plot(
        x,
        [*y, y[-1]],
        drawstyle="steps-post",
        color=GREY,
        linewidth=1.4,
        linestyle=(0, (5, 3)),
        zorder=1,
    )


def _labels(axes: Axes, found: Frontier, least: float) -> None:
    """Names in the margin; least: between two of them, in heights of the panel."""
    if not found.points:
        return
    low, high = np.log(axes.get_ylim())
    heights = [float((np.log(p.error.value) - low) / (high - low)) for p in found.points]
    places = spread(heights, least)
    shift = max(0.0, -min(places)) - max(0.0, max(places) - 1.0)
    for point, place in zip(found.points, places, strict=True):
        axes.annotate(
            point.label,
            (point.latency.value, point.error.value),
            (1.03, place + shift),
            xycoords="data",
            textcoords="axes fraction",
            va="center",
            fontsize=8,
            color=GREY if point.label in found.dominated else "black",
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "color": "#AAAAAA",
                "linewidth": 0.6,
                "shrinkA": 1,
                "shrinkB": 5,
                "relpos": (0, 0.5),
            },
        )


def _legend(looks: dict[str, dict[str, Any]]) -> list[Line2D]:
    handles = [
        Line2D([], [], linestyle="none", markersize=7, label=model, **look)
        for model, look in looks.items()
    ]
    hollow = Line2D(
        [],
        [],
        linestyle="none",
        marker="o",
        markersize=7,
        markerfacecolor="white",
        color=GREY,
        label="hollow: dominated beyond the intervals",
    )
    steps = Line2D([], [], color=GREY, linestyle=(0, (5, 3)), label="least error within a time")
    return [*handles, hollow, steps]
