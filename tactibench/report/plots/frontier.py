"""Speed against error: every point with its name, the frontier as a line."""

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
    legend_below,
    legend_mark,
    log_ticks,
    model_look,
    new_figure,
    plain,
    short_label,
)

Box = tuple[float, float, float, float]
LINE_INCH, LETTER_INCH = 0.17, 0.066
"""Height of a name, and width of one of its letters."""
PANEL_INCH = 8.2
"""Width of a panel, nearly."""
GAP = 0.012
"""Between a point and its name, as a share of the panel."""
TRIES = 8
"""Lines that a name may be moved up or down."""
FADED = 0.45
TITLE = "Speed against error; bars: 95 % over presses, of all seeds"


def frontier_figure(
    frontiers: Sequence[Frontier], error: Ranking, *, title: str = TITLE, measured_on: str = ""
) -> Figure:
    """Draw latency against error with intervals, one panel a regime on the same log axes.

    Colour and marker by model; filled: not dominated, hollow: dominated. Names stand beside their
    points.
    """
    count = max(1, len(frontiers))
    height = 3.6
    figure = new_figure(9.5, height * count + 1.3)
    panels = figure.subplots(count, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    points = [point for frontier in frontiers for point in frontier.points]
    if points:
        _set_scales(panels[0], points)
    for axes, frontier in zip(panels, frontiers, strict=False):
        for point in frontier.points:
            _show_point(axes, point, hollow=point.label in frontier.dominated)
        _show_line(axes, frontier.best)
        _show_labels(axes, frontier, height - 0.5)
        axes.set_title(f"trained in regime {frontier.regime}", fontsize=10, loc="left")
    for axes in panels:
        axes.set_ylabel(f"{error.name}, {error.unit}")
        plain(axes)
    panels[-1].set_xlabel("one frame to contacts, p90 on one thread, ms")
    if points:
        models = sorted({_model(point) for point in points})
        legend_below(figure, min(5, 2 + len(models)), _legend(models))
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
            axes.set(yscale="log", ylim=(low / margin, high * margin**1.5))  # room for a name
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


def _show_labels(axes: Axes, frontier: Frontier, inches: float) -> None:
    """Write every name beside its point, where no other name or point stands.

    Args:
        axes: With its limits set.
        frontier: The points of the panel.
        inches: Height of the panel.
    """
    line = LINE_INCH / inches
    low, high = (np.log(limits) for limits in zip(axes.get_xlim(), axes.get_ylim(), strict=True))
    values = [(point.latency.value, point.error.value) for point in frontier.points]
    places = [tuple((np.log(value) - low) / (high - low)) for value in values]
    taken = [(x - GAP, y - line / 4, x + GAP, y + line / 4) for x, y in places]
    for point, (x, y) in zip(frontier.points, places, strict=True):
        name = short_label(point.label)
        width = LETTER_INCH * len(name) / PANEL_INCH
        box = _free_box(x, y, width, line, taken)
        taken.append(box)
        far = abs(box[1] + line / 2 - y) > 1.5 * line
        leader = {"arrowstyle": "-", "color": "#AAAAAA", "linewidth": 0.6, "shrinkB": 5}
        axes.annotate(
            name,
            (point.latency.value, point.error.value),
            (box[0], box[1] + line / 2),
            xycoords="data",
            textcoords="axes fraction",
            va="center",
            fontsize=8,
            color=GREY if point.label in frontier.dominated else "black",
            annotation_clip=False,
            bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.6},
            arrowprops=leader | {"relpos": (float(box[0] < x), 0.5)} if far else None,
        )


def _free_box(x: float, y: float, width: float, line: float, taken: Sequence[Box]) -> Box:
    """Return the nearest box for a name, in axes fractions: left, bottom, right, top.

    Above, below or on the line of the point's bars, to the right before the left, then further up
    and down.
    """
    shifts = [0.8, -0.8, 0.0, *(sign * (k + 0.8) for k in range(1, TRIES) for sign in (1, -1))]
    boxes = [
        (left, y + (k - 0.5) * line, left + width, y + (k + 0.5) * line)
        for k in shifts
        for gap in [0.7 * GAP if k else 1.5 * GAP]
        for left in (x + gap, x - gap - width)
        if left > 0 and (k + 0.5) * line < 1 - y
    ]
    return next((box for box in boxes if not any(_overlap(box, t) for t in taken)), boxes[0])


def _overlap(one: Box, other: Box) -> bool:
    apart = one[0] >= other[2] or other[0] >= one[2] or one[1] >= other[3] or other[1] >= one[3]
    return not apart


def _legend(models: Sequence[str]) -> list[Line2D]:
    handles = [_mark(short_label(model), model_look(model)) for model in models]
    hollow = _mark(
        "hollow: dominated beyond the intervals", Look(GREY, "o"), markerfacecolor="white"
    )
    steps = Line2D([], [], color=GREY, linestyle=(0, (5, 3)), label="least error within a time")
    return [*handles, hollow, steps]


def _mark(label: str, look: Look, **more: Any) -> Line2D:
    return legend_mark(label, markersize=7, **look.points, **more)
