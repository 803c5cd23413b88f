"""Speed against error: every point with its number, the frontier as a line, names in a key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tactibench.board import NOMINAL, Frontier, Point, Section, elsewhere_frontiers, settled
from tactibench.protocols import Ranking, board_spec, load_protocol
from tactibench.report.style import (
    GREY,
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
FADED = 0.45
STEPS: dict[str, Any] = {"color": GREY, "linestyle": (0, (5, 3)), "linewidth": 1.4}
TITLE = "Speed against error; bars: 95 % over presses, of all seeds"


@dataclass(frozen=True)
class Unseen:
    """Frontiers of the same configurations on sensors that no training saw.

    Attributes:
        title: Title above the panels.
        axis: Name of the error.
        frontiers: One frontier a regime.
    """

    title: str
    axis: str
    frontiers: tuple[Frontier, ...]


def unseen_frontiers(protocol: str, here: Section, nominal: Sequence[Frontier]) -> Unseen | None:
    """Return the frontiers of the same configurations on sensors that no training saw.

    Args:
        protocol: Name of the protocol.
        here: Section of the nominal frontiers.
        nominal: Frontiers of the rows of ``here``.

    Returns:
        None where ``here`` is not of the nominal sensor, or fewer than two rows were tested so.
    """
    spec = board_spec(protocol)
    for test in load_protocol(protocol).spec.test.apart if here.kind == NOMINAL else ():
        if test.instances and (error := spec.apart.get(test.name)):
            frontiers = tuple(elsewhere_frontiers(nominal, here.rows, error))
            if sum(len(frontier.points) for frontier in frontiers) > 1:
                title = f"{len(test.instances)} sensors that no training saw"
                return Unseen(title, f"{error.name}, {error.unit}", frontiers)
    return None


@in_own_style
def frontier_figure(
    frontiers: Sequence[Frontier],
    error: Ranking,
    *,
    unseen: Unseen | None = None,
    title: str = TITLE,
    measured_on: str = "",
) -> Figure:
    """Draw latency against error with intervals, a row of panels a regime, on logarithmic axes.

    A model has its colour and marker. Filled marks are not dominated, hollow marks are. A number
    stands beside each point; the key below the panels says which row it is. A row has the same
    number in all panels. A star says that its time is not settled.

    Args:
        frontiers: One frontier a regime.
        error: Error that ranks the rows.
        unseen: The same configurations on unseen sensors, in a second column of panels.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    shown = [k for k, one in enumerate(frontiers) if one.points] or list(range(len(frontiers)))[:1]
    columns = [("", f"{error.name}, {error.unit}", frontiers)]
    if unseen is not None:
        columns.append((unseen.title, unseen.axis, unseen.frontiers))
    points = [point for k in shown for point in frontiers[k].points]
    models = {point.label: _model(point) for point in points}
    numbers = {label: k for k, label in enumerate(sorted(models), 1)}
    down = max(1, len(shown))
    figure = new_figure(9.5, HEIGHT_INCH * down + 0.7 + 0.1 * (len(models) + 3))
    panels = figure.subplots(down, len(columns), squeeze=False, sharex=True, sharey="col")
    for line, k in zip(panels, shown, strict=False):
        for axes, (words, axis, each) in zip(line, columns, strict=True):
            _show_frontier(axes, each[k], numbers)
            names = filter(None, (f"trained in regime {each[k].regime}", words))
            axes.set_title("\n".join(map(short_label, names)), fontsize=9.5, loc="left")
            axes.set_ylabel(axis)
    for axes in panels.flat:
        plain(axes)
    for axes in panels[-1]:
        axes.set_xlabel("one frame to contacts, p90 on one thread, ms")
    if points:
        key = [
            legend_mark(f"{number}  {short_label(label)}", **model_look(models[label]).points)
            for label, number in numbers.items()
        ]
        hollow = {"marker": "o", "color": GREY, "markerfacecolor": "white"}
        key.append(legend_mark("hollow: dominated beyond the intervals", **hollow))
        key.append(Line2D([], [], **STEPS, label="least error within a time"))
        if not all(settled(point.row) for point in points):
            key.append(legend_mark("*  time not settled: drifting, or measured beside other work"))
        legend_below(figure, 2, key)
    headline(figure, title, measured_on)
    return figure


def _show_frontier(axes: Axes, frontier: Frontier, numbers: Mapping[str, int]) -> None:
    """Draw the points with their numbers, and the least error that is reached within a time."""
    if frontier.points:
        axes.set(xscale="log", yscale="log")
        axes.margins(0.08, 0.12)
    for point in frontier.points:
        hollow = point.label in frontier.dominated
        _show_point(axes, point, hollow=hollow)
        axes.annotate(
            f"{numbers[point.label]}{'' if settled(point.row) else '*'}",
            (point.latency.value, point.error.value),
            (5, 5),
            textcoords="offset points",
            fontsize=8,
            color=GREY if hollow else "black",
        )
    if frontier.best:
        x = [point.latency.value for point in frontier.best]
        y = [point.error.value for point in frontier.best]
        axes.plot(
            [*x, axes.get_xlim()[1]], [*y, y[-1]], drawstyle="steps-post", scalex=False, **STEPS
        )
    if frontier.points:
        for axis in (axes.xaxis, axes.yaxis):
            log_ticks(axis)


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
