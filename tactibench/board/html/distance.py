"""Two-point discrimination: error against distance, and how likely a pair is seen as two."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.special import expit

from tactibench.board.html.figure import (
    GREY,
    Figure,
    Looks,
    Option,
    Panel,
    Trace,
    axis,
    bars,
    lines,
    rounded,
)
from tactibench.board.html.inert import figure_text
from tactibench.board.html.words import seeds_words, with_interval
from tactibench.board.numbers import number
from tactibench.board.published import PublishedTable, published_means
from tactibench.board.rows import Pooled, Row
from tactibench.contacts import FloatArray
from tactibench.metrics.groups import condition
from tactibench.metrics.threshold import SHARE, Profile
from tactibench.records.record import Record

ERRORS = (
    ("distance_mae_mm", "over resolved pairs", "error of the distance, mm"),
    ("distance_penalised_mm", "penalised", "penalised error of the distance, mm"),
)
ROWS = 16
"""Rows of a section that are shown, the best first: more could not be told apart."""
CURVE = 56
"""Distances at which a fitted curve is drawn."""


def distance_panels(
    rows: Sequence[Row], published: Sequence[PublishedTable], looks: Looks, *, simulated: bool
) -> list[Panel]:
    """Nothing where no row has a result at several distances."""
    able = [row for row in rows if not row.trivial and len(_groups(row, "resolved")) > 1][:ROWS]
    if not able:
        return []
    means = published_means(published)
    options = [_errors(metric, label, title, able, means, looks) for metric, label, title in ERRORS]
    where = "hardware, published: another sensor and other presses" if simulated else "published"
    dotted = f" Dotted lines: means over all distances, {where}." if means else ""
    return [
        Panel(
            "Error against distance",
            "Means over seeds; bars: 95 % over presses. Hollow: less than half of the pairs were "
            f"resolved, so that the error is one of few. Penalised: an unresolved pair counts its "
            f"true distance.{dotted}",
            tuple(options),
            "error",
        ),
        Panel(
            "Seen as two",
            "Share of pairs resolved (exactly two contacts predicted, both matched) with 95 % "
            "intervals over presses, and the logistic fit behind the threshold, the distance at "
            "which it reaches 75 % (large mark). Curves are means of the seeds' fits; where one "
            "does not cross 75 % at any tested distance, the points are joined instead.",
            (Option("", (_psychometric(able, looks),)),),
        ),
    ]


def _groups(row: Row, metric: str) -> list[str]:
    """Distances at which all seeds have a value, ascending."""
    names = {m.group for m in row.first.metrics if m.metric == metric}
    known = {n: d for n in names if (d := condition(n)) is not None and row.metric(metric, n)}
    return sorted(known, key=known.__getitem__)


def _pooled(row: Row, metric: str) -> tuple[list[str], list[Pooled]]:
    found = [
        (name, value)
        for name in _groups(row, metric)
        if (value := row.metric(metric, name)) is not None
    ]
    return [name for name, _ in found], [value for _, value in found]


def _errors(
    metric: str,
    label: str,
    title: str,
    rows: Iterable[Row],
    means: Sequence[tuple[str, float]],
    looks: Looks,
) -> Option:
    traces, table, without = [], [], []
    for row in rows:
        names, values = _pooled(row, metric)
        if not names:
            without.append(row.label)
            continue
        shares = [row.metric("resolved", name) for name in names]
        share = [None if s is None else s.value for s in shares]
        traces.append(_line(row, metric, names, values, share, looks))
        table += [
            (
                row.label,
                name,
                with_interval(v.value, v.low, v.high, 3),
                "n/a" if s is None else f"{number(100 * s, 0)} %",
            )
            for name, v, s in zip(names, values, share, strict=True)
        ]
    layout = {
        "xaxis": axis("true distance of the two tips, mm", dtick=1),
        "yaxis": axis(title, rangemode="tozero"),
        "shapes": [_rule(value) for _, value in means],
        "annotations": [_named(label, value) for label, value in means],
    }
    heads = ("model", "distance, mm", "error, mm", "resolved")
    note = f"No pair resolved by any seed: {', '.join(without)}." if without else ""
    return Option(label, (Figure(tuple(traces), layout, heads, tuple(table), height=460),), note)


def _line(
    row: Row,
    metric: str,
    names: Sequence[str],
    values: Sequence[Pooled],
    share: Sequence[float | None],
    looks: Looks,
) -> Trace:
    look = looks.of(row)
    hollow = [metric == "distance_mae_mm" and s is not None and s < 0.5 for s in share]
    text = [
        lines(
            row.label,
            f"{name} mm apart: {with_interval(v.value, v.low, v.high, 3)} mm",
            "" if s is None else f"{number(100 * s, 0)} % resolved",
            _presses(v),
            seeds_words(row),
        )
        for name, v, s in zip(names, values, share, strict=True)
    ]
    middle = [v.value for v in values]
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "name": figure_text(row.label),
        "x": [float(name) for name in names],
        "y": rounded(middle),
        "error_y": {
            **bars(middle, [v.low for v in values], [v.high for v in values]),
            "color": look.colour,
        },
        "line": {"color": look.colour, "dash": look.dash, "width": 1.8},
        "marker": {
            "color": look.colour,
            "size": 8,
            "symbol": [look.symbol + "-open" * h for h in hollow],
        },
        "hoverinfo": "text",
        "hovertext": text,
    }


def _presses(found: Pooled) -> str:
    low, high = found.clusters
    return f"{low:,} presses" if low == high else f"{low:,} to {high:,} presses"


def _psychometric(rows: Sequence[Row], looks: Looks) -> Figure:
    traces: list[Trace] = []
    table = []
    for row in rows:
        traces += _curve(row, looks)
        found, caught = row.metric("threshold_mm", "all"), row.metric("catch_resolved", "all")
        every = row.metric("resolved", "all")
        table.append(
            (
                row.label,
                _threshold(found),
                "n/a"
                if every is None
                else with_interval(every.value, every.low, every.high, 1, 100),
                "n/a" if caught is None else f"{number(100 * caught.value, 1)} %",
            )
        )
    layout = {
        "xaxis": axis("true distance of the two tips, mm", dtick=1),
        "yaxis": axis("pairs seen as two, %", range=[-4, 104]),
        "shapes": [_rule(100 * SHARE)],
    }
    heads = ("model", "threshold, mm", "resolved, %", "single seen as two")
    return Figure(tuple(traces), layout, heads, tuple(table), height=460)


def _threshold(found: Pooled | None) -> str:
    if found is None:
        return "n/a"
    if found.censored:
        return f"{found.censored} {number(found.value, 2)}"
    return with_interval(found.value, found.low, found.high, 2)


def _curve(row: Row, looks: Looks) -> list[Trace]:
    look = looks.of(row)
    names, values = _pooled(row, "resolved")
    share = [100 * v.value for v in values]
    text = [
        lines(
            row.label,
            f"{name} mm apart: {with_interval(v.value, v.low, v.high, 1, 100)} % seen as two",
            _presses(v),
            seeds_words(row),
        )
        for name, v in zip(names, values, strict=True)
    ]
    ends = [
        [None if e is None else 100 * e for e in side]
        for side in ([v.low for v in values], [v.high for v in values])
    ]
    x = np.linspace(float(names[0]), float(names[-1]), CURVE)
    fits = [fit for record in row.records if (fit := fitted(record, x)) is not None]
    whole = len(fits) == len(row.records)
    made: list[Trace] = [
        {
            "type": "scatter",
            "mode": "markers" if whole else "lines+markers",
            "name": figure_text(row.label),
            "legendgroup": figure_text(row.label),
            "x": [float(name) for name in names],
            "y": rounded(share),
            "error_y": {**bars(share, *ends), "color": look.colour},
            "marker": {"color": look.colour, "size": 7, "symbol": look.symbol},
            "line": {"dash": look.dash, "color": look.colour, "width": 1.4},
            "hoverinfo": "text",
            "hovertext": text,
        }
    ]
    if whole:
        made.append(
            {
                "type": "scatter",
                "mode": "lines",
                "showlegend": False,
                "legendgroup": figure_text(row.label),
                "x": rounded(x),
                "y": rounded(100 * np.mean(fits, axis=0)),
                "hoverinfo": "skip",
                "line": {"color": look.colour, "dash": look.dash, "width": 2},
            }
        )
    found = row.metric("threshold_mm", "all")
    if found is not None and not found.censored:
        made.append(_mark(row, found, look.colour, look.symbol))
    return made


def _mark(row: Row, found: Pooled, colour: str, symbol: str) -> Trace:
    text = lines(row.label, f"threshold {_threshold(found)} mm", seeds_words(row))
    side = bars([found.value], [found.low], [found.high])
    return {
        "type": "scatter",
        "mode": "markers",
        "showlegend": False,
        "legendgroup": figure_text(row.label),
        "x": rounded([found.value]),
        "y": [100 * SHARE],
        "error_x": {**side, "color": colour, "thickness": 2.4},
        "marker": {"color": colour, "size": 13, "symbol": symbol, "line": {"width": 2}},
        "hoverinfo": "text",
        "hovertext": [text],
    }


def fitted(record: Record, distance: FloatArray) -> FloatArray | None:
    """(N,) the logistic fit of a run at distances, mm, from its counts and its threshold.

    The slope is the most likely one at the threshold, as in ``tactibench.metrics.threshold``. None
    where the run has no threshold, or a censored one: no fit of these answers crosses 75 % there.
    """
    rows = [m for m in record.metrics if m.metric == "resolved" and m.value is not None]
    known = [(d, m) for m in rows if (d := condition(m.group)) is not None]
    found = record.metric("threshold_mm", "all")
    if len(known) < 2 or found is None or found.value is None or found.censored:
        return None
    known.sort(key=lambda pair: pair[0])
    trials = np.array([float(m.n) for _, m in known])
    hits = np.rint([(m.value or 0.0) * m.n for _, m in known])
    profile = Profile(np.array([d for d, _ in known]), hits, trials)
    middle = np.array([found.value])
    slope = profile.slope(middle)
    return np.asarray(expit(Profile(distance, distance, distance).logit(middle, slope))[0])


def _rule(value: float) -> Trace:
    line = {"color": GREY, "width": 1.2, "dash": "dot"}
    return {
        "type": "line",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "y0": value,
        "y1": value,
        "line": line,
        "layer": "below",
    }


def _named(label: str, value: float) -> Trace:
    return {
        "xref": "paper",
        "x": 1,
        "xanchor": "right",
        "y": value,
        "yanchor": "bottom",
        "text": figure_text(f"{label} {value:g} mm, published"),
        "showarrow": False,
        "font": {"size": 11},
    }
