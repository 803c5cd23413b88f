"""Speed against error: every point with its number, the frontier as a line, names in a key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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

HEIGHT_INCH = 3.4
COLUMNS = 2
"""Columns of the key: a name of a row is up to half as long as the picture is wide."""
KEY_INCH = 0.2
"""Height of a line of the key, inches."""
FADED = 0.45
WIDE_INCH = 8.6
"""Approximate width of all panels beside each other."""
GAP_INCH = 0.15
"""Distance between a number and the points and numbers around it."""
BESIDE_INCH = [(x, y) for x in (0.13, -0.13, 0.0) for y in (0.11, -0.11)] + [(0.17, 0), (-0.17, 0)]
"""Places of a number beside its point, in the order in which they are tried."""
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
    for axes, (condition, frontier) in zip(panels.flat, drawn, strict=False):
        if points:
            alike = [p for other, one in drawn if other.axis == condition.axis for p in one.points]
            _set_scales(axes, [p.latency for p in points], [p.error for p in alike])
        _show_line(axes, frontier.best)
        for point in frontier.points:
            _show_point(axes, point, hollow=point.label in frontier.dominated)
        _show_numbers(axes, frontier, WIDE_INCH / across, numbers)
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
    axes.plot(
        x.value,
        y.value,
        linestyle="none",
        marker=look.marker,
        markersize=7,
        markeredgewidth=1.4,
        markerfacecolor="white" if hollow else look.color,
        markeredgecolor=look.color,
        zorder=3,
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


def _show_numbers(axes: Axes, frontier: Frontier, width: float, numbers: Mapping[str, int]) -> None:
    """Write the number of each point beside it, at the first place that is free, or else freest.

    Args:
        axes: Panel with its limits set.
        frontier: Points of the panel.
        width: Width of the panel, inches.
        numbers: Label of a row -> its number.
    """
    low, high = np.log([axes.get_xlim(), axes.get_ylim()]).T
    points = [(point.latency.value, point.error.value) for point in frontier.points]
    places = (np.log(points) - low) / (high - low) * (width, HEIGHT_INCH - 0.5)
    taken = list(places)
    for k, (point, place) in enumerate(zip(frontier.points, places, strict=True)):
        gaps = []
        for offset in BESIDE_INCH:
            others = np.array([*taken[:k], *taken[k + 1 :]]).reshape(-1, 2)
            gaps.append(np.linalg.norm(others - place - offset, axis=1).min(initial=1.0))
        free = [gap > GAP_INCH for gap in gaps]
        best = free.index(True) if any(free) else int(np.argmax(gaps))
        taken.append(place + BESIDE_INCH[best])
        axes.annotate(
            f"{numbers[point.label]}{'' if settled(point.row) else '*'}",
            (point.latency.value, point.error.value),
            (72 * BESIDE_INCH[best][0], 72 * BESIDE_INCH[best][1]),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=8,
            color=GREY if point.label in frontier.dominated else "black",
        )


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
