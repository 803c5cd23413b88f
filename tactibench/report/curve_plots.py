"""Curves of rows over the distance of two tips and over graded hard cases."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MultipleLocator

from tactibench.board import (
    FamilyErrors,
    Row,
    family_errors,
    gather_records,
    ordered,
    select_section,
    whole,
)
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols import Axis, PublishedTable, load_protocol, published_means
from tactibench.report.board_tables import doubling_table
from tactibench.report.style import (
    CURVES,
    DASHES,
    GREY,
    Look,
    PlotData,
    draw_line,
    first_rows,
    headline,
    in_own_style,
    legend_below,
    log_ticks,
    new_figure,
    plain,
    row_looks,
    short_label,
)

COLUMNS = 3
DODGE = 0.07
"""Distance between the rows, in steps of the axis, so that bars do not overlap."""
TENTH = 0.1
"""Share of missed contacts from which a marker is hollow."""
DODGE_MM = 0.05
"""Distance between rows by distance, so that interval bars do not overlap."""
FEW = 50
"""Per cent of resolved pairs below which a mark is hollow: its error is that of few pairs."""
HOLLOW: dict[str, Any] = {"linestyle": "none", "markerfacecolor": "white", "zorder": 3}
DASHED: dict[str, Any] = {"color": GREY, "linestyle": (0, (5, 3)), "linewidth": 1.2, "zorder": 1}


def by_distance(
    row: Row, metric: str, scale: float = 1.0
) -> dict[float, tuple[float, float | None, float | None]]:
    """Return distance, mm -> value, low and high of a metric, ascending; n/a is left out."""
    groups = dict.fromkeys(m.group for m in row.first.metrics if m.metric == metric)
    pooled = {float(g): row.metric(metric, g) for g in groups if g[:1].isdigit()}
    return {
        distance: (
            m.value * scale,
            None if m.low is None else m.low * scale,
            None if m.high is None else m.high * scale,
        )
        for distance, m in sorted(pooled.items())
        if m is not None
    }


@in_own_style
def distance_figure(
    rows: Sequence[Row], *, published: Sequence[PublishedTable] = (), measured_on: str = ""
) -> Figure:
    """Draw the distance error with intervals, and below it the share of pairs resolved as two.

    A large mark stands at the threshold of 75 %, which is that of a logistic fit.

    Args:
        rows: Rows in the order of the legend.
        published: Tables whose mean distance errors become dashed lines.
        measured_on: Printed as subtitle, such as "simulated sensor tactip-127".
    """
    figure = new_figure(8.0, 7.0)
    errors, shares = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    some_few = some_drawn = False
    for k, (row, look) in enumerate(zip(rows, _looks(rows), strict=True)):
        shift = DODGE_MM * (k - (len(rows) - 1) / 2)
        error, resolved = by_distance(row, "distance_mae_mm"), by_distance(row, "resolved", 100)
        label = short_label(row.label) + ("" if error else ": no pair resolved")
        draw_line(errors, [d + shift for d in error], list(error.values()), look, label)
        few = [d for d in error if d in resolved and resolved[d][0] < FEW]
        x, y = [d + shift for d in few], [error[d][0] for d in few]
        errors.plot(x, y, markersize=5.5, **HOLLOW, **look.points)
        draw_line(shares, [d + shift for d in resolved], list(resolved.values()), look)
        threshold = row.metric("threshold_mm", "all")
        if threshold is not None and not threshold.censored:
            shares.plot(threshold.value, 75, markersize=11, **look.points)
        some_few |= bool(few)
        some_drawn |= any(value > 0 for value, _, _ in error.values())
    shares.axhline(75, **DASHED)
    for (name, value), dash in zip(published_means(published), DASHES[1:], strict=False):
        label = f"{short_label(name)}, {value:g} mm: hardware, published"
        errors.axhline(value, **{**DASHED, "linestyle": dash}, label=label)
    if some_drawn:
        errors.set_yscale("log", nonpositive="mask")
        log_ticks(errors.yaxis)
    errors.set_ylabel("error of the distance, mm\n(mean over resolved pairs)")
    shares.set(ylim=(-6, 106), yticks=[0, 25, 50, 75, 100], ylabel="pairs resolved\nas two, %")
    shares.set_xlabel("true distance of the two tips, mm")
    shares.xaxis.set_major_locator(MultipleLocator(1.0))
    for axes in (errors, shares):
        plain(axes)
    if rows:
        legend_below(figure, 2, *errors.get_legend_handles_labels())
    hollow_note = "hollow: less than half resolved" if some_few else ""
    title = "Two-point discrimination; large mark: the threshold, at which 75 % are resolved"
    headline(figure, title, measured_on, "bars: 95 % interval over presses", hollow_note)
    return figure


def _looks(rows: Sequence[Row]) -> list[Look]:
    return row_looks([row.first.model.name for row in rows])


@in_own_style
def stability_figure(rows: Sequence[Row], axes: Sequence[Axis], *, measured_on: str = "") -> Figure:
    """Draw a panel for every family with an easy case; the values are evenly spaced.

    Args:
        rows: The models, in the order of the legend.
        axes: Axes of the families.
        measured_on: Printed as subtitle.
    """
    families = [family_errors(row, axes) for row in rows]
    looks = _looks(rows)
    shown = [k for k, grade in enumerate(families[0]) if len(grade.cases) > 1]
    count = math.ceil(len(shown) / COLUMNS)
    figure = new_figure(9.0, 2.0 * count + 1.1)
    panels = np.atleast_1d(figure.subplots(count, COLUMNS)).reshape(count, COLUMNS)
    for panel, k in zip(panels.flat, shown, strict=False):
        grades = [grades[k] for grades in families]
        _show_family(panel, grades, looks, [row.label for row in rows])
    for panel in panels.flat[len(shown) :]:
        panel.set_axis_off()
    for line in panels:
        line[0].set_ylabel("error, mm", fontsize=9)
    handles, labels = panels.flat[0].get_legend_handles_labels()
    legend_below(figure, 2, handles, labels)
    notes = "bars: 95 % over presses; hollow: a tenth of the contacts missed, or more"
    headline(figure, "Hard cases: error from the easy case on", measured_on, notes)
    return figure


def _show_family(
    axes: Axes, grades: Sequence[FamilyErrors], looks: Sequence[Look], labels: Sequence[str]
) -> None:
    axis, middle = grades[0].axis, (len(grades) - 1) / 2
    drawn = 0
    for k, (grade, look, label) in enumerate(zip(grades, looks, labels, strict=True)):
        drawn += _show_curve(axes, grade, DODGE * (k - middle), label, look)
    values = [case.value for case in grades[0].cases]
    axes.set_xticks(range(len(values)), [f"{value:g}" for value in values], fontsize=7)
    if drawn:  # an error of 0 has no place on a logarithmic axis
        axes.set_yscale("log")
        log_ticks(axes.yaxis)
        axes.yaxis.set_major_locator(LogLocator(numticks=6))
    axes.tick_params(axis="y", labelsize=8)
    unit = f", {axis.unit}" if axis.unit else ""
    axes.set_title(f"{axis.family}{unit}", fontsize=9, loc="left")
    plain(axes)
    axes.axvline(0.5, color=GREY, linewidth=0.6, linestyle=(0, (2, 2)))  # after the easy case


def _show_curve(axes: Axes, family: FamilyErrors, shift: float, label: str, look: Look) -> int:
    """Draw one row on one family and return how many errors were drawn."""
    drawn = [
        (k, case, case.error)
        for k, case in enumerate(family.cases)
        if case.error is not None and case.error.value > 0
    ]
    x = [k + shift for k, _, _ in drawn]
    errors = [(error.value, error.low, error.high) for _, _, error in drawn]
    line = look if family.axis.ordered else replace(look, line="none")
    sizes = {"linewidth": 1.1, "elinewidth": 0.8, "capsize": 1.5, "markersize": 3.5}
    draw_line(axes, x, errors, line, short_label(label), **sizes)
    missed = [case.missed is not None and case.missed.value >= TENTH for _, case, _ in drawn]
    for place, (value, _, _), hollow in zip(x, errors, missed, strict=True):
        if hollow:
            axes.plot(place, value, markersize=3.5, **HOLLOW, **look.points)
    return len(drawn)


def stability_data(
    protocol: str, board: Path, runs: Path | None, sensor: str | None, labels: tuple[str, ...]
) -> PlotData:
    """Return the value at which the error of every model doubles on graded hard cases.

    Args:
        protocol: Name of the protocol.
        board: Folder of the leaderboards.
        runs: A run store; None: none.
        sensor: Name of the sensor; None: the nominal one.
        labels: Labels of the rows that are shown, in this order; () for all.

    Raises:
        UserError: There is nothing to show.
    """
    axes = load_protocol(protocol).spec.axes
    if not axes:
        raise UserError(f"{protocol} has no families of hard cases; take stability.")
    section = select_section(whole(gather_records(protocol, board, runs)), sensor, protocol)
    chosen = ordered(protocol, section.rows)
    by_label = {row.label: row for row in chosen}
    for label in labels:
        if label not in by_label:
            raise UserError(f"no row is called {label!r}; {did_you_mean(label, by_label)}")
    chosen = [by_label[label] for label in labels] or [row for row in chosen if not row.trivial]
    subject = f"{protocol}, {section.title.lower()}"
    rows = list(_stability_rows(chosen, axes))
    return PlotData(
        subject,
        (doubling_table(chosen, axes),),
        rows,
        partial(stability_figure, chosen[:CURVES], axes, measured_on=subject),
        first_rows(len(chosen)),
    )


def _stability_rows(rows: Sequence[Row], axes: Sequence[Axis]) -> Iterator[dict[str, Any]]:
    """Yield the values at which errors double, and the errors case by case."""
    for row in rows:
        for grade in family_errors(row, axes):
            axis, doubles = grade.axis, grade.doubles
            subject = {"group": row.label, "family": axis.family}
            if doubles is not None:
                ends = {"value": doubles.value, "low": doubles.low, "high": doubles.high}
                limits = {"censored": doubles.censored, "limits": doubles.limits}
                facts = {"unit": axis.unit, "harder": axis.harder}
                yield {"metric": "doubles_at", **subject, **ends, **limits, **facts}
            for case in grade.cases:
                if case.error is not None:
                    error = case.error
                    ends = {"value": error.value, "low": error.low, "high": error.high}
                    place = {"at": case.value, "easy": case.easy}
                    yield {"metric": "ospa_mm", **subject, **place, **ends, "unit": "mm"}
