"""Speed against error, and error against training presses: pictures, and the numbers behind them.

The runs are the committed records of a board, and the complete runs of a store. Seeds are pooled.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from matplotlib.ticker import FixedLocator, NullLocator, PercentFormatter, StrMethodFormatter
from matplotlib.transforms import Bbox

from tactibench.board import (
    Curve,
    Frontier,
    Point,
    Range,
    Section,
    all_records,
    count_left_out,
    counts,
    curves,
    elsewhere_frontiers,
    frontiers,
    gather_records,
    machine,
    new_sensor_curves,
    ranking_error,
    select_section,
    settled,
    unseen_error,
    whole,
)
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols import Ranking, load_protocol
from tactibench.report.board_tables import curve_table
from tactibench.report.style import (
    CURVES,
    GREY,
    PlotData,
    draw_line,
    first_rows,
    headline,
    in_own_style,
    legend_below,
    legend_mark,
    log_ticks,
    model_look,
    new_figure,
    plain,
    row_looks,
    short_label,
)
from tactibench.report.tables import (
    Column,
    Format,
    Head,
    Number,
    Table,
    fixed,
    is_share,
    plural,
    significant,
    table,
)

HEIGHT_INCH = 3.4
FADED = 0.45
MARK_PX = 16
"""Side of the square around a mark that no label enters, px of a picture."""
PLACES = tuple(
    (far * x, far * y)
    for far in (5, 11, 18)
    for x, y in ((1, 1), (-1, 1), (1, -1), (-1, -1), (0, 1.6), (0, -1.6), (1.6, 0), (-1.6, 0))
)
"""Places of a label around its mark, pt, the best first."""
STEPS: dict[str, Any] = {"color": GREY, "linestyle": (0, (5, 3)), "linewidth": 1.4}
FRONTIER_NOTE = (
    "Range: from the lowest end of the seeds' intervals to the highest; a time is at "
    "least 2 % wide. Dominated: another of the same regime is better on both by more than "
    "the ranges. *: the time is not settled. Trivial rows are left out."
)
DODGE = 0.012
"""Distance between learning curves, as a share of the presses, so that bars do not overlap."""


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
    error = unseen_error(load_protocol(protocol)) if here.nominal else None
    if error is None:
        return None
    frontiers = tuple(elsewhere_frontiers(nominal, here.rows, error))
    if sum(len(frontier.points) for frontier in frontiers) < 2:
        return None
    return Unseen("sensors that no training saw", error.head, frontiers)


@in_own_style
def frontier_figure(
    frontiers: Sequence[Frontier],
    error: Ranking,
    *,
    unseen: Unseen | None = None,
    measured_on: str = "",
) -> Figure:
    """Draw latency against error with intervals, a row of panels a regime, on logarithmic axes.

    A model has its colour and marker. Filled marks are not dominated, hollow marks are. Beside each
    point stands its name where each model has one row, else a number that the key below the panels
    explains; a row has the same number in all panels. A star says that its time is not settled.

    Args:
        frontiers: One frontier a regime.
        error: Error that ranks the rows.
        unseen: The same configurations on unseen sensors, in a second column of panels.
        measured_on: Printed as subtitle.
    """
    shown = [k for k, one in enumerate(frontiers) if one.points] or list(range(len(frontiers)))[:1]
    columns = [("the sensor of the training" if unseen else "", error.head, frontiers)]
    if unseen is not None:
        columns.append((unseen.title, unseen.axis, unseen.frontiers))
    points = [point for k in shown for point in frontiers[k].points]
    models = {point.label: _model(point) for point in points}
    named = len(set(models.values())) == len(models)
    words = {label: label if named else str(k) for k, label in enumerate(sorted(models), 1)}
    down = max(1, len(shown))
    height = HEIGHT_INCH * down + 0.7 + 0.1 * (3 + (0 if named else len(models)))
    figure = new_figure(9.5, height)
    panels = figure.subplots(down, len(columns), squeeze=False, sharex=True, sharey="col")
    for line, k in zip(panels, shown, strict=False):
        for axes, (where, axis, each) in zip(line, columns, strict=True):
            _show_frontier(axes, each[k], words)
            regime = f"trained in regime {each[k].regime}" if len(frontiers) > 1 else ""
            names = filter(None, (regime, where))
            axes.set_title("\n".join(map(short_label, names)), fontsize=9.5, loc="left")
            axes.set_ylabel(axis)
    for axes in panels.flat:
        plain(axes)
        if is_share(error.metric):
            axes.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=" %"))
    for axes in panels[-1]:
        axes.set_xlabel("one frame to contacts, p90 on one thread, ms")
    if points:
        key = [
            legend_mark(f"{number}  {short_label(label)}", **model_look(models[label]).points)
            for label, number in words.items()
            if not named
        ]
        hollow = {"marker": "o", "color": GREY, "markerfacecolor": "white"}
        key.append(legend_mark("hollow: dominated beyond the intervals", **hollow))
        key.append(Line2D([], [], **STEPS, label="least error within a time"))
        if not all(settled(point.row) for point in points):
            key.append(legend_mark("*  time not settled: drifting, or measured beside other work"))
        legend_below(figure, 2, key)
    title = "Speed against error; bars: 95 % intervals, of all seeds"
    headline(figure, title, measured_on)
    figure.draw_without_rendering()  # the panels take their sizes
    for axes in panels.flat:
        _part_labels(axes)
    return figure


def _part_labels(axes: Axes) -> None:
    """Move every label to the first place around its mark that no other mark or label holds."""
    taken = [
        Bbox.from_bounds(x - MARK_PX / 2, y - MARK_PX / 2, MARK_PX, MARK_PX)
        for x, y in (axes.transData.transform(label.xy) for label in _labels(axes))
    ]
    inside = axes.get_window_extent()
    for label in _labels(axes):
        for x, y in PLACES:
            label.set(position=(x, y), ha="left" if x > 0 else "right" if x else "center")
            label.set_verticalalignment("bottom" if y > 0 else "top" if y else "center")
            box = label.get_window_extent()
            free = not any(box.overlaps(other) for other in taken)
            if free and inside.x0 < box.x0 and box.x1 < inside.x1:
                break
        taken.append(label.get_window_extent())


def _labels(axes: Axes) -> list[Annotation]:
    return [text for text in axes.texts if isinstance(text, Annotation)]


def _show_frontier(axes: Axes, frontier: Frontier, words: Mapping[str, str]) -> None:
    """Draw the points with their names or numbers, and the least error within each time."""
    if frontier.points:
        axes.set(xscale="log", yscale="log")
        axes.margins(0.08, 0.12)
    for point in frontier.points:
        hollow = point.label in frontier.dominated
        _show_point(axes, point, hollow=hollow)
        axes.annotate(
            f"{short_label(words[point.label])}{'' if settled(point.row) else '*'}",
            (point.latency.value, point.error.value),
            PLACES[0],
            textcoords="offset points",
            fontsize=8,
            color=GREY if hollow else "black",
        )
    if frontier.best:
        x = [point.latency.value for point in frontier.best]
        y = [point.error.value for point in frontier.best]
        slowest = max(point.latency.high for point in frontier.points)  # panels share their ends
        axes.plot([*x, slowest], [*y, y[-1]], drawstyle="steps-post", **STEPS)
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


def frontier_data(
    protocol: str, board: Path, runs: Path | None, sensor: str | None, fingerprint: str | None
) -> PlotData:
    """Return the models that are fast for their error, by regime.

    Args:
        protocol: Name of the protocol.
        board: Folder of the leaderboards.
        runs: A run store; None: none.
        sensor: Name of the sensor; None: the nominal one.
        fingerprint: Fingerprint of the machine; None: that of most runs.

    Raises:
        UserError: There is nothing to show.
    """
    records = whole(gather_records(protocol, board, runs))
    section = select_section(records, sensor, protocol)
    error = ranking_error(protocol)
    machines = sorted({machine(record) for row in section.rows for record in row.records})
    if fingerprint is not None and fingerprint not in machines:
        raise UserError(
            f"no run was timed on a machine {fingerprint!r}; {did_you_mean(fingerprint, machines)}"
        )
    regimes = frontiers(section.rows, error, fingerprint)
    timed = [point for regime in regimes for point in regime.points]
    subject = f"{protocol}, {section.title.lower()}"
    if timed:
        subject += f", timed on {timed[0].row.first.environment.cpu} ({regimes[0].machine})"
    remarks = list(_frontier_remarks(regimes))
    if hidden := count_left_out(records, section):
        remarks.append(f"Left out: {plural(hidden, 'run')} on other sensors.")

    unseen = unseen_frontiers(protocol, section, regimes)
    return PlotData(
        subject,
        tuple(frontier_table(regime, error) for regime in regimes),
        [line for regime in regimes for line in _frontier_rows(regime, error)],
        partial(frontier_figure, regimes, error, unseen=unseen, measured_on=subject),
        tuple(remarks),
    )


def frontier_table(frontier: Frontier, error: Ranking) -> Table:
    """Return the points of one regime as a table, sorted by latency."""

    def ranged(value: Range, write: Format, mark: str = "") -> Number:
        return Number(value.value, write, (value.low, value.high), mark=mark)

    heads: list[Head] = [
        f"regime {frontier.regime}",
        Column("seeds"),
        "p90 and range, ms",
        f"{error.head}, and range",
        "",
    ]
    rows = [
        (
            point.label,
            str(len(point.row.records)),
            ranged(point.latency, significant, "" if settled(point.row) else "*"),
            ranged(point.error, fixed(error.decimals)),
            frontier.verdict(point),
        )
        for point in frontier.points
    ]
    return table(heads, rows)


def _frontier_remarks(regimes: Sequence[Frontier]) -> Iterator[str]:
    """Yield how to read the tables and what they leave out, one sentence each."""
    yield FRONTIER_NOTE
    if elsewhere := sum(frontier.elsewhere for frontier in regimes):
        here = regimes[0].machine
        yield f"Left out: {plural(elsewhere, 'run')} timed on another machine than {here}."
    untimed = [f"{name} ({regime.regime})" for regime in regimes for name in regime.untimed]
    if untimed:
        yield f"Left out, without an error or a time: {'; '.join(untimed)}."


def _frontier_rows(frontier: Frontier, error: Ranking) -> Iterator[dict[str, Any]]:
    """Yield two tidy rows for every point: its latency and its error."""
    for point in frontier.points:
        for metric, value, unit in (
            ("p90_ms", point.latency, "ms"),
            (error.metric, point.error, error.unit),
        ):
            yield {
                "metric": metric,
                "group": point.label,
                "value": value.value,
                "low": value.low,
                "high": value.high,
                "unit": unit,
                "dominated_by": list(frontier.dominated.get(point.label, ())),
                "on_frontier": point in frontier.best,
                "regime": frontier.regime,
                "machine": frontier.machine,
                "seeds": list(point.row.seeds),
            }


def curve_data(
    protocol: str, board: Path, runs: Path | None, sensor: str | None, *, new_sensor: bool
) -> PlotData:
    """Return the learning curves of a protocol.

    Args:
        protocol: Name of the protocol.
        board: Folder of the leaderboards.
        runs: A run store; None: none.
        sensor: Name of the sensor; None: the nominal one.
        new_sensor: Whether the curves are against the labelled presses of a sensor instance that no
            training saw.

    Raises:
        UserError: There is nothing to show.
    """
    error = ranking_error(protocol)
    if new_sensor:
        name = sensor or load_protocol(protocol).spec.defaults.sensor
        learning = new_sensor_curves(all_records(protocol, board, runs), error, name)
        lacking = (
            f"no run of {protocol} on sensor {name!r} was tested on another instance than it was "
            f"trained on; make some with `tactibench run {protocol} --model MODEL "
            "--test sensor.instance=1`."
        )
        subject = f"{protocol}, simulated sensor {name}, instances that no training saw"
    else:
        section = select_section(gather_records(protocol, board, runs), sensor, protocol)
        learning = curves(section.rows, error)
        lacking = (
            f"no configuration of {protocol} was run with several numbers of presses; make some "
            f"with `tactibench run {protocol} --model MODEL --presses N`."
        )
        subject = f"{protocol}, {section.title.lower()}"
    if not learning:
        raise UserError(lacking)

    drawn = learning[:CURVES]
    draw = partial(curve_figure, drawn, error, new_sensor=new_sensor, measured_on=subject)
    shown = tuple(filter(None, [curve_table(learning, error)]))
    return PlotData(subject, shown, _curve_rows(learning, error), draw, first_rows(len(learning)))


def _curve_rows(learning: Sequence[Curve], error: Ranking) -> list[dict[str, Any]]:
    """Return a tidy row for every step of every curve."""
    return [
        {
            "metric": error.metric,
            "group": curve.label,
            "presses": step.presses,
            "value": step.error and step.error.value,
            "low": step.error and step.error.low,
            "high": step.error and step.error.high,
            "sd": step.error and step.error.sd,
            "unit": error.unit,
            "seeds": step.seeds,
        }
        for curve in learning
        for step in curve.steps
    ]


@in_own_style
def curve_figure(
    curves: Sequence[Curve], error: Ranking, *, new_sensor: bool = False, measured_on: str = ""
) -> Figure:
    """Draw every curve with its bars, on logarithmic axes.

    Where a curve has a step with no presses, the axis is linear up to half the fewest other
    presses.

    Args:
        curves: Learning curves.
        error: Error on the vertical axis.
        new_sensor: Whether the presses are labelled ones of a new sensor.
        measured_on: Printed as subtitle.
    """
    figure = new_figure(8.0, 5.2)
    axes = figure.subplots()
    middle = (len(curves) - 1) / 2
    drawn = counts(curves)
    # A logarithmic axis has no place for 0, so it is linear below half the fewest presses.
    few = min(filter(None, drawn), default=2) / 2 if 0 in drawn else 0.0
    looks = row_looks([curve.model for curve in curves])
    for k, (curve, look) in enumerate(zip(curves, looks, strict=True)):
        points = [(step.presses, step.error) for step in curve.steps if step.error is not None]
        shift = DODGE * (k - middle)
        x = [presses + max(presses, few) * shift for presses, _ in points]
        errors = [(pooled.value, pooled.low, pooled.high) for _, pooled in points]
        draw_line(axes, x, errors, look, short_label(curve.label))
    presses = "labelled presses of the new sensor"
    if not new_sensor:
        presses = "presses that the model learned from"
    axes.set(yscale="log", xlabel=presses, ylabel=error.head)
    if few:
        axes.set_xscale("symlog", linthresh=few, linscale=0.5)
        axes.set_xlim(-few / 2, 1.2 * max(drawn))
    else:
        axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator(drawn or [1000]))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes.xaxis.set_minor_locator(NullLocator())
    log_ticks(axes.yaxis, subs=(1, 2, 3, 5))
    plain(axes)
    if curves:
        legend_below(figure, 2)
    title = "Learning curve; bars: 95 % over presses, mean of the seeds"
    if new_sensor:
        title = "What a new sensor costs; mean over instances, bars: the best and the worst"
    headline(figure, title, measured_on)
    return figure
