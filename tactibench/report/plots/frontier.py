"""Speed against error: every point named in the margin, the frontier as a line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tactibench.board.frontier import Frontier, Point
from tactibench.protocols.board_spec import Ranking
from tactibench.report.plots.style import (
    GREY,
    Look,
    headline,
    log_ticks,
    model_look,
    new_figure,
    plain,
    short_label,
    spread,
)

LINE_INCH = 0.19
"""Height of a label in the margin."""
FADED = 0.45
TITLE = "Speed against error; bars: 95 % over presses, of all seeds"


def frontier_figure(
    frontiers: Sequence[Frontier], error: Ranking, *, title: str = TITLE, measured_on: str = ""
) -> Figure:
    """Draw latency against error with intervals, one panel a regime on the same log axes.

    Colour and marker by model; filled: not dominated, hollow: dominated. Labels stand in the right
    margin in the order of the errors, each joined to its point.
    """
    most = max((len(frontier.points) for frontier in frontiers), default=0)
    count = max(1, len(frontiers))
    height = max(3.6, LINE_INCH * most + 0.7)
    figure = new_figure(9.5, height * count + 1.3)
    panels = figure.subplots(count, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    points = [point for frontier in frontiers for point in frontier.points]
    if points:
        _set_scales(panels[0], points)
    for axes, frontier in zip(panels, frontiers, strict=False):
        for point in frontier.points:
            _show_point(axes, point, hollow=point.label in frontier.dominated)
        _show_line(axes, frontier.best)
        _show_labels(axes, frontier, LINE_INCH / (height - 0.5))
        axes.set_title(f"trained in regime {frontier.regime}", fontsize=10, loc="left")
    for axes in panels:
        axes.set_ylabel(f"{error.name}, {error.unit}")
        plain(axes)
    panels[-1].set_xlabel("one frame to contacts, p90 on one thread, ms")
    if points:
        models = sorted({_model(point) for point in points})
        figure.legend(
            handles=_legend(models),
            loc="outside lower center",
            ncols=min(5, 2 + len(models)),
            frameon=False,
            fontsize=9,
        )
    headline(figure, title, measured_on)
    return figure


def _model(point: Point) -> str:
    return point.row.first.model.name


def _show_point(axes: Axes, point: Point, *, hollow: bool) -> None:
    x, y, look = point.latency, point.error, model_look(_model(point))
    axes.errorbar(
        x.value,
        y.value,
        [[y.value - y.low], [y.high - y.value]],
        [[x.value - x.low], [x.high - x.value]],
        fmt="none",
        ecolor=look.color,
        elinewidth=1.1,
        alpha=FADED if hollow else 1.0,
    )
    face = "white" if hollow else look.color
    axes.plot(
        x.value,
        y.value,
        linestyle="none",
        markersize=7,
        markeredgewidth=1.4,
        markerfacecolor=face,
        zorder=3,
        **look.points,
    )


def _set_scales(axes: Axes, points: Sequence[Point]) -> None:
    for axis, ranges in (("x", [p.latency for p in points]), ("y", [p.error for p in points])):
        low = min(min(r.low for r in ranges if r.low > 0), min(r.value for r in ranges))
        high = max(r.high for r in ranges)
        margin = max((high / low) ** 0.06, 1.1)
        if axis == "x":
            axes.set(xscale="log", xlim=(low / margin, high * margin))
        else:
            axes.set(yscale="log", ylim=(low / margin, high * margin))
        subs = (1, 2, 5) if high / low < 300 else (1,)
        log_ticks(axes.xaxis if axis == "x" else axes.yaxis, subs)


def _show_line(axes: Axes, best: Sequence[Point]) -> None:
    """Draw the least error that is reached within a time: steps through the best points."""
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


def _show_labels(axes: Axes, frontier: Frontier, least: float) -> None:
    """Write names in the margin; least: between two of them, in heights of the panel."""
    if not frontier.points:
        return
    low, high = np.log(axes.get_ylim())
    heights = [float((np.log(p.error.value) - low) / (high - low)) for p in frontier.points]
    places = spread(heights, least)
    shift = max(0.0, -min(places)) - max(0.0, max(places) - 1.0)
    for point, place in zip(frontier.points, places, strict=True):
        axes.annotate(
            short_label(point.label),
            (point.latency.value, point.error.value),
            (1.03, place + shift),
            xycoords="data",
            textcoords="axes fraction",
            va="center",
            fontsize=8,
            color=GREY if point.label in frontier.dominated else "black",
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


def _legend(models: Sequence[str]) -> list[Line2D]:
    handles = [_mark(short_label(model), model_look(model)) for model in models]
    hollow = _mark(
        "hollow: dominated beyond the intervals", Look(GREY, "o"), markerfacecolor="white"
    )
    steps = Line2D([], [], color=GREY, linestyle=(0, (5, 3)), label="least error within a time")
    return [*handles, hollow, steps]


def _mark(label: str, look: Look, **more: Any) -> Line2D:
    return Line2D([], [], linestyle="none", markersize=7, label=label, **look.points, **more)
