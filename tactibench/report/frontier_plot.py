"""Speed against error: every point with its number, the frontier as a line, the names in a key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tactibench.board import KINDS, Frontier, Point, Range, Section, elsewhere_frontiers, settled
from tactibench.board import NOMINAL as NOMINAL_KIND
from tactibench.protocols import Ranking, board_spec, load_protocol
from tactibench.report.style import (
    GREY,
    Look,
    headline,
    in_own_style,
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
"""Height of a number, and width of one of its digits, inches."""
WIDE_INCH, NARROW_INCH = 8.4, 4.3
"""Approximate width of a single panel, and of each of two beside each other, inches."""
HEIGHT_INCH = 3.4
COLUMNS = 2
"""Columns of the key: a name of a row is up to half as long as the picture is wide."""
TINY = 1e-12
"""Value that replaces 0, which a logarithmic axis does not have."""
GAP = 0.09
"""Distance between a point and its number, inches."""
STRANGE = 0.12
"""Distance between a number and the points of other rows, inches."""
KEY_INCH = 0.2
"""Height of a line of the key, inches."""
FADED = 0.45
TITLE = "Speed against error; bars: 95 % over presses, of all seeds"
NOMINAL = "nominal"


@dataclass(frozen=True)
class Condition:
    """Frontiers on one set of test frames.

    Attributes:
        title: Title above the panels.
        frontiers: One frontier a regime.
        axis: Name of the error where it is another one than the nominal; "" where it is the same.
    """

    title: str
    frontiers: tuple[Frontier, ...]
    axis: str = ""

    @property
    def count(self) -> int:
        """Number of points."""
        return sum(len(frontier.points) for frontier in self.frontiers)


def off_nominal(
    protocol: str, here: Section, sections: Sequence[Section], nominal: Sequence[Frontier]
) -> list[Condition]:
    """Return the frontiers of the same configurations where the sensor is not the nominal one.

    Args:
        protocol: Name of the protocol.
        here: Section of the nominal frontiers.
        sections: All sections of the board.
        nominal: Frontiers of the rows of ``here``.

    Returns:
        At most one condition: the other sensor instances that the protocol presses; without rows
        of these, the section of the same sensor with most of the configurations. A condition with
        a single point shows no order and is left out. Empty where ``here`` is not of the nominal
        sensor.
    """
    spec = board_spec(protocol)
    if here.kind != NOMINAL_KIND or spec.ranking is None:
        return []
    unseen, moved = [], []
    for test in load_protocol(protocol).spec.test.apart:
        if test.instances and (error := spec.apart.get(test.name)):
            frontiers = elsewhere_frontiers(nominal, here.rows, error)
            words = f"off-nominal: {len(test.instances)} sensors that no training saw"
            unseen.append(Condition(words, tuple(frontiers), f"{error.name}, {error.unit}"))
    for section in sections:
        if section.kind != NOMINAL_KIND and section.sensor.name == here.sensor.name:
            test_sensor = section.record.test_sensor
            words = KINDS[section.kind] if test_sensor is None else test_sensor.description
            frontiers = elsewhere_frontiers(nominal, section.rows, spec.ranking)
            moved.append(Condition(f"off-nominal: {words}", tuple(frontiers)))
    moved.sort(key=lambda one: -one.count)
    return [one for one in (*unseen, *moved) if one.count > 1][:1]


@in_own_style
def frontier_figure(
    frontiers: Sequence[Frontier],
    error: Ranking,
    *,
    off_nominal: Sequence[Condition] = (),
    title: str = TITLE,
    measured_on: str = "",
) -> Figure:
    """Draw latency against error with intervals, a panel a regime and condition, on log axes.

    Panels of one error have the same axes. A model has its colour and marker. Filled marks are not
    dominated, hollow marks are. A number stands beside each point; the key below the panels says
    which row it is. A row has the same number in all panels. A star says that its time is not
    settled.

    Args:
        frontiers: One frontier a regime.
        error: Error that ranks the rows.
        off_nominal: The same configurations on other test frames, in panels of their own.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    shown = [k for k, one in enumerate(frontiers) if one.points] or list(range(len(frontiers)))[:1]
    conditions = [Condition(NOMINAL if off_nominal else "", tuple(frontiers)), *off_nominal]
    drawn = [
        (condition, condition.frontiers[k])
        for k in shown
        for condition in conditions
        if len(condition.frontiers[k].points) > 1 or condition is conditions[0]
    ]
    across = 2 if off_nominal else 1
    down = max(1, -(-len(drawn) // across))
    points = [point for _, frontier in drawn for point in frontier.points]
    models = {point.label: _model(point) for point in points}
    numbers = {label: k for k, label in enumerate(sorted(models), 1)}
    lines = -(-(len(models) + 3) // COLUMNS)
    figure = new_figure(9.5, HEIGHT_INCH * down + 0.7 + KEY_INCH * lines)
    panels = figure.subplots(down, across, squeeze=False)
    size = (WIDE_INCH if across == 1 else NARROW_INCH, HEIGHT_INCH - 0.5)
    for axes, (condition, frontier) in zip(panels.flat, drawn, strict=False):
        if points:
            alike = [p for other, one in drawn if other.axis == condition.axis for p in one.points]
            _set_scales(axes, [p.latency for p in points], [p.error for p in alike])
        _show_line(axes, frontier.best)
        for point in frontier.points:
            _show_point(axes, point, hollow=point.label in frontier.dominated)
        _show_numbers(axes, frontier, size, numbers)
        names = filter(None, (f"trained in regime {frontier.regime}", condition.title))
        axes.set_title("\n".join(map(short_label, names)), fontsize=9.5, loc="left")
        axes.set_ylabel(condition.axis or f"{error.name}, {error.unit}")
    for axes in panels.flat:
        plain(axes)
    for axes in panels.flat[len(drawn) :]:
        axes.set_visible(False)
    for axes in panels.flat[max(0, len(drawn) - across) :]:
        axes.set_xlabel("one frame to contacts, p90 on one thread, ms")
    if points:
        key = [
            _mark(f"{number}  {short_label(label)}", model_look(models[label]))
            for label, number in numbers.items()
        ]
        unsettled = not all(settled(point.row) for point in points)
        legend_below(figure, COLUMNS, [*key, *_other_marks(unsettled=unsettled)])
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


def _set_scales(axes: Axes, times: Sequence[Range], errors: Sequence[Range]) -> None:
    for axis, ranges in (("x", times), ("y", errors)):
        low = min(min(r.low for r in ranges if r.low > 0), min(r.value for r in ranges))
        high = max(r.high for r in ranges)
        margin = max((high / low) ** 0.06, 1.1)
        if axis == "x":
            axes.set(xscale="log", xlim=(low / margin, high * margin))
        else:
            axes.set(yscale="log", ylim=(low / margin, high * margin**1.5))  # room for a name
        log_ticks(axes.xaxis if axis == "x" else axes.yaxis, _subs(high / low))


def _subs(ratio: float) -> Sequence[float]:
    """Return the multiples that are numbered in a decade; more where an axis is short."""
    if ratio > 300:
        return (1,)
    return (1, 2, 5) if ratio > 6 else (1, 1.5, 2, 3, 4, 5, 7)


def _show_line(axes: Axes, best: Sequence[Point]) -> None:
    """Draw the smallest error that is reached within a time: steps through the best points."""
    if not best:
        return
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


def _show_numbers(
    axes: Axes, frontier: Frontier, size: tuple[float, float], numbers: Mapping[str, int]
) -> None:
    """Write the number of each point beside it, where no other number or point stands.

    Args:
        axes: Panel with its limits set.
        frontier: Points of the panel.
        size: Width and height of the panel, inches.
        numbers: Label of a row -> its number.
    """
    low, high = (np.log(limits) for limits in zip(axes.get_xlim(), axes.get_ylim(), strict=True))
    values = [(point.latency.value, point.error.value) for point in frontier.points]
    places = [tuple((np.log(value) - low) / (high - low) * size) for value in values]
    occupied: list[Box] = []
    lines = [
        tuple(np.ravel((np.log(np.maximum(ends, TINY)) - low) / (high - low) * size))
        for ends in [*_bars(frontier.points), *_steps(frontier.best, axes.get_xlim()[1])]
    ]
    for point, (x, y) in zip(frontier.points, places, strict=True):
        number = f"{numbers[point.label]}{'' if settled(point.row) else '*'}"
        boxes = _boxes_beside(x, y, LETTER_INCH * len(number), size)
        points = [
            _around(place, GAP if place == (x, y) else STRANGE) for place in places
        ]  # a number must not seem to belong to another point
        near = [_around(place, GAP) for place in places]
        # A number across a bar is better than none; one between points of almost one place, which
        # the key tells apart, than one across another number.
        tries = ([*points, *occupied, *lines], [*points, *occupied], [*near, *occupied], occupied)
        free = (_first_free(boxes, taken) for taken in tries)
        box = next((box for box in free if box is not None), boxes[0])
        occupied.append(box)
        axes.annotate(
            number,
            ((box[0] + box[2]) / 2 / size[0], (box[1] + box[3]) / 2 / size[1]),
            xycoords="axes fraction",
            ha="center",
            va="center",
            fontsize=8,
            color=GREY if point.label in frontier.dominated else "black",
            annotation_clip=False,
        )


def _around(place: tuple[float, ...], gap: float) -> Box:
    x, y = place
    return x - gap, y - gap, x + gap, y + gap


def _bars(points: Sequence[Point]) -> Iterator[list[tuple[float, float]]]:
    """Yield the ends of all bars, lower left and upper right, in the units of the axes."""
    for point in points:
        x, y = point.latency, point.error
        yield [(x.low, y.value), (x.high, y.value)]
        yield [(x.value, y.low), (x.value, y.high)]


def _steps(best: Sequence[Point], right: float) -> Iterator[list[tuple[float, float]]]:
    """Yield the ends of the pieces of the line, lower left and upper right."""
    x = [*(point.latency.value for point in best), right]
    for k, point in enumerate(best):
        y = point.error.value
        yield [(x[k], y), (x[k + 1], y)]
        if k:
            yield [(x[k], y), (x[k], best[k - 1].error.value)]


def _boxes_beside(x: float, y: float, width: float, size: tuple[float, float]) -> list[Box]:
    """Return the boxes that a number of a point may have: left, bottom, right, top, inches.

    They are in the order in which they are tried: above or below to the right, then to the left,
    then above and below the middle, then beside.

    Args:
        x: Place of the point from the left of the panel, inches.
        y: Place of the point from the bottom of the panel, inches.
        width: Width of the number, inches.
        size: Width and height of the panel, inches.
    """
    up, half = 0.8 * LINE_INCH, LINE_INCH / 2
    places = [(x + GAP, y + s * up) for s in (1, -1)]
    places += [(x - GAP - width, y + s * up) for s in (1, -1)]
    places += [(x - width / 2, y + s * 1.1 * LINE_INCH) for s in (1, -1)]
    places += [(x + 1.6 * GAP, y), (x - 1.6 * GAP - width, y)]
    boxes = [(left, middle - half, left + width, middle + half) for left, middle in places]
    inside = [b for b in boxes if b[0] > 0 and b[1] > 0 and b[2] < size[0] and b[3] < size[1]]
    return inside or boxes


def _first_free(boxes: Sequence[Box], taken: Sequence[Box]) -> Box | None:
    return next((b for b in boxes if not any(_overlap(b, t) for t in taken)), None)


def _overlap(one: Box, other: Box) -> bool:
    apart = one[0] >= other[2] or other[0] >= one[2] or one[1] >= other[3] or other[1] >= one[3]
    return not apart


def _other_marks(*, unsettled: bool) -> list[Line2D]:
    """Return the entries of the key that are no rows.

    Args:
        unsettled: Whether a time of the picture is not settled.
    """
    hollow = _mark(
        "hollow: dominated beyond the intervals", Look(GREY, "o"), markerfacecolor="white"
    )
    steps = Line2D([], [], color=GREY, linestyle=(0, (5, 3)), label="least error within a time")
    star = Line2D(
        [],
        [],
        linestyle="none",
        label="*  time not settled: drifting, or measured beside other work",
    )
    return [hollow, steps, star] if unsettled else [hollow, steps]


def _mark(label: str, look: Look, **more: Any) -> Line2D:
    return legend_mark(label, markersize=7, **look.points, **more)
