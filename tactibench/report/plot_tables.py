"""Tables and tidy rows of ``tactibench plot``: the numbers behind its pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from tactibench.board import (
    Curve,
    Frontier,
    LimitMaps,
    Range,
    Row,
    family_errors,
    settled,
    spacing_summary,
    summary,
)
from tactibench.frames import D_PRIME, FALSELY_SEEN, SEEN
from tactibench.protocols import Axis, Ranking
from tactibench.report.numbers import Format, fixed, plural, significant
from tactibench.report.table import Cell, Column, Head, Number, Table, metric_number, table

JsonRows = list[dict[str, Any]]
FRONTIER_NOTE = (
    "Range: from the lowest end of the seeds' intervals to the highest; a time is at "
    "least 2 % wide. Dominated: another of the same regime is better on both by more than "
    "the ranges. *: the time is not settled. Trivial rows are left out."
)


def frontier_table(frontier: Frontier, error: Ranking) -> Table:
    """Return the points of one regime as a table, sorted by latency."""
    heads: list[Head] = [
        f"regime {frontier.regime}",
        Column("seeds"),
        "p90 and range, ms",
        f"error and range, {error.unit}",
        "",
    ]
    rows = [
        (
            point.label,
            str(len(point.row.records)),
            _range(point.latency, significant, "" if settled(point.row) else "*"),
            _range(point.error, fixed(error.decimals)),
            frontier.verdict(point),
        )
        for point in frontier.points
    ]
    return table(heads, rows)


def frontier_remarks(frontiers: Sequence[Frontier]) -> Iterator[str]:
    """Yield how to read the tables and what they leave out, one sentence each."""
    yield FRONTIER_NOTE
    if elsewhere := sum(frontier.elsewhere for frontier in frontiers):
        machine = frontiers[0].machine
        yield f"Left out: {plural(elsewhere, 'run')} timed on another machine than {machine}."
    untimed = [f"{name} ({regime.regime})" for regime in frontiers for name in regime.untimed]
    if untimed:
        yield f"Left out, without an error or a time: {'; '.join(untimed)}."


def frontier_rows(frontier: Frontier, error: Ranking) -> JsonRows:
    """Return two tidy rows for every point: its latency and its error."""
    rows = []
    for point in frontier.points:
        verdict = {
            "dominated_by": list(frontier.dominated.get(point.label, ())),
            "on_frontier": point in frontier.best,
            "regime": frontier.regime,
            "machine": frontier.machine,
            "seeds": list(point.row.seeds),
        }
        for metric, value, unit in (
            ("p90_ms", point.latency, "ms"),
            (error.metric, point.error, error.unit),
        ):
            ends = {"value": value.value, "low": value.low, "high": value.high}
            rows.append({"metric": metric, "group": point.label, **ends, "unit": unit, **verdict})
    return rows


def _range(value: Range, write: Format, mark: str = "") -> Number:
    return Number(value.value, write, (value.low, value.high), mark=mark)


def curve_steps_table(curves: Sequence[Curve], error: Ranking) -> Table:
    """Return a table with every step of every curve, its interval and its spread."""
    rows: list[list[Cell]] = []
    for curve in curves:
        for k, step in enumerate(curve.steps):
            sd = None if step.error is None else step.error.sd
            rows.append(
                [
                    "" if k else curve.label,
                    f"{step.presses:,}",
                    metric_number(step.error, error.decimals),
                    None if sd is None else Number(sd, fixed(error.decimals)),
                    str(step.seeds),
                ]
            )
    counts = (Column("sd of seeds"), Column("seeds"))
    return table(
        ("", Column("presses"), f"error, {error.unit}", *counts),
        rows,
        title=f"{error.name} by training presses: value [95 % interval]",
    )


def new_sensor_table(curves: Sequence[Curve], error: Ranking) -> Table:
    """Return a table with every step of curves on a new sensor: mean, best and worst instance."""
    rows: list[list[Cell]] = []
    for curve in curves:
        for k, step in enumerate(curve.steps):
            number = metric_number(step.error, error.decimals)
            rows.append(["" if k else curve.label, f"{step.presses:,}", number, str(step.seeds)])
    return table(
        ("", Column("labelled presses"), f"error, {error.unit}", Column("runs")),
        rows,
        title=f"{error.name} on a new sensor: mean over instances [best, worst]",
    )


def curve_rows(curves: Sequence[Curve], error: Ranking) -> JsonRows:
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
        for curve in curves
        for step in curve.steps
    ]


def stability_rows(rows: Sequence[Row], axes: Sequence[Axis]) -> JsonRows:
    """Return tidy rows with the values at which errors double, and the errors case by case."""
    lines = []
    for row in rows:
        for grade in family_errors(row, axes):
            axis, doubles = grade.axis, grade.doubles
            subject = {"group": row.label, "family": axis.family}
            if doubles is not None:
                ends = {"value": doubles.value, "low": doubles.low, "high": doubles.high}
                facts = {"censored": doubles.censored, "unit": axis.unit, "harder": axis.harder}
                lines.append({"metric": "doubles_at", **subject, **ends, **facts})
            for case in grade.cases:
                if case.error is not None:
                    error = case.error
                    ends = {"value": error.value, "low": error.low, "high": error.high}
                    place = {"at": case.value, "easy": case.easy}
                    lines.append({"metric": "ospa_mm", **subject, **place, **ends, "unit": "mm"})
    return lines


def limit_table(maps: LimitMaps) -> Table:
    """Return the quantiles over the workspace, um, with one row per depth and quantity."""
    heads: list[Head] = [
        *("depth, mm", "sd of", "middle", "median", "90 %", "worst", "at x, y mm"),
        Column("presses"),
    ]
    rows: list[list[Cell]] = []
    last = None
    for line in summary(maps):
        names = ("middle", "median", "p90", "worst")
        bounds = (_bound(line.get(name), micrometres) for name in names)
        place = "{:+.1f}, {:+.1f}".format(*line["worst_at"]) if "worst_at" in line else ""
        depth = "" if line["depth"] == last else f"{line['depth']:g}"
        rows.append([depth, line["quantity"], *bounds, place, f"{line['n']:,}"])
        last = line["depth"]
    return table(heads, rows, title="Cramer-Rao bound: smallest standard deviation, um")


def spacing_table(maps: LimitMaps) -> Table:
    """Return the spacings from which two tips differ from one, mm, with one row per depth."""
    heads: list[Head] = [
        *("depth, mm", "middle", "median", "90 %", "worst", "at x, y mm"),
        Column("presses"),
    ]
    rows: list[list[Cell]] = []
    for line in spacing_summary(maps):
        ends = (_bound(line.get(k), _millimetres) for k in ("middle", "median", "p90", "worst"))
        place = "{:+.1f}, {:+.1f}".format(*line["worst_at"]) if "worst_at" in line else ""
        rows.append([f"{line['depth']:g}", *ends, place, f"{line['n']:,}"])
    return table(heads, rows, title="Two tips differ from one from this spacing on, mm")


def _bound(value: float | None, write: Callable[[float], str]) -> Number | None:
    return None if value is None or math.isnan(value) else Number(value, write)


def _millimetres(value: float) -> str:
    return "none" if math.isinf(value) else f"{value:.2f}"


def micrometres(value: float) -> str:
    """Return mm as um with three digits: "0.834", "12.9", "1,480"; "inf" without a bound."""
    if math.isinf(value):
        return "inf"
    micro = 1000 * value
    return f"{micro:,.0f}" if micro >= 999.5 else f"{micro:#.3g}"


def limit_remarks(maps: LimitMaps) -> Iterator[str]:
    """Yield what the numbers leave out, one sentence each."""
    per_depth = summary(maps)[:: len(maps.request.quantities)]
    presses = f"of {maps.request.presses:,} presses"
    if len(maps.request.indenter.offsets) > 1:
        yield "x, y, depth: of the worse of the two tips."
    if unbounded := sum(line["unbounded"] for line in per_depth):
        yield f"{unbounded:,} {presses} have no bound, since a tip leaves no trace."
    if refused := sum(line["refused"] for line in per_depth):
        yield f"{refused:,} {presses} are refused: {maps.refusal}"


def spacing_remarks(maps: LimitMaps) -> Iterator[str]:
    """Yield how the spacings were decided and what they leave out, one sentence each."""
    diameter = 2 * maps.request.indenter.radius
    yield (
        f"Smallest spacing at which an ideal observer of the frames sees {SEEN:.0%} of the pairs, "
        f"and {FALSELY_SEEN:.0%} of single presses, as two (d' = {D_PRIME:.1f}); "
        "the --spacing does not enter."
    )
    yield f"Below {diameter:g} mm the two spheres overlap: two tips of one tool."
    lines = spacing_summary(maps)
    if unbounded := sum(line["unbounded"] for line in lines):
        total = len(lines) * math.prod(maps.request.coarse.shape)
        presses = f"{unbounded:,} of {total:,} presses"
        yield f"{presses} have no such spacing: one tip leaves the dome before."
