"""Where on the sensor a model errs: cells of the workspace, with what was missed in each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tactibench.board.html.answers import Answered
from tactibench.board.html.figure import Figure, Option, Panel, Trace, axis
from tactibench.board.numbers import number
from tactibench.board.ranking import RANKING
from tactibench.board.rows import Row
from tactibench.contacts import FloatArray
from tactibench.metrics.groups import members
from tactibench.metrics.location import top_answers
from tactibench.metrics.trials import PlateTrials, Trials
from tactibench.records.record import Record
from tactibench.stats.intervals import mean_interval

CELLS = 8
"""A side: a cell of 1.6 mm holds about 16 of the 1,000 presses of exp1."""

ROWS = 10
"""Rows of a section that are shown, the best first."""

AnswersOf = Callable[[Record], Answered | None]


@dataclass(frozen=True, eq=False)
class Errors:
    """One value per true contact (or plate). x, y: (N,) where. error: (N,) mm, nan where it was
    missed. press: (N,) ids."""

    x: FloatArray
    y: FloatArray
    error: FloatArray
    press: np.ndarray[tuple[int], np.dtype[np.str_]]


@dataclass(frozen=True)
class Field:
    """What the two axes and the error of a map are called. span: low and high of either axis."""

    x: str
    y: str
    error: str
    span: tuple[tuple[float, float], tuple[float, float]]
    missed: str


def error_maps(rows: Sequence[Row], answers_of: AnswersOf) -> Panel | None:
    """A choice of rows; None where no row has its answers and their truth at hand."""
    options = []
    field = None
    for row in [row for row in rows if not row.trivial][:ROWS]:
        found = answers_of(row.first)
        if found is not None:
            field = _field(found)
            options.append(_option(row, field, errors_of(found)))
    if field is None:
        return None
    caption = (
        f"Mean {field.error} in {CELLS} x {CELLS} cells, of the first seed. Beside it "
        f"the share of {field.missed} in the same cells. Each map has a scale of its own."
    )
    return Panel("Error over the workspace", caption, tuple(options), "model")


def errors_of(one: Answered) -> Errors:
    """Of every true contact that is no catch trial; exp1 scores the best prediction ungated."""
    trials = one.trials
    press = np.asarray(one.presses)
    if isinstance(trials, PlateTrials):
        return _plates(one, trials, press)
    if one.single:
        return _top(trials, press)
    return _matched(trials, press)


def _plates(
    one: Answered, trials: PlateTrials, press: np.ndarray[tuple[int], np.dtype[np.str_]]
) -> Errors:
    """Of the answers that order the board: in transfer those without labelled frames."""
    group = np.array(trials.group or ("all",) * len(trials), dtype=object)
    by = RANKING.get(one.keys.id)
    use = group == by.group if by is not None and by.group in group else group == group[0]
    rows = [
        (pose.tilt, pose.depth, np.nan if found is None else abs(found.depth - pose.depth))
        for pose, found, wanted in zip(trials.truth, trials.predictions, use, strict=True)
        if wanted and pose is not None
    ]
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return Errors(table[:, 0], table[:, 1], table[:, 2], press[use])


def _top(trials: Trials, press: np.ndarray[tuple[int], np.dtype[np.str_]]) -> Errors:
    true, predicted, index = top_answers(trials)
    every = np.array([c.xy[0] for c in trials.truth]).reshape(-1, 2)
    error = np.full(len(every), np.nan)
    error[index] = np.hypot(*(predicted - true)[:, :2].T)
    return Errors(every[:, 0], every[:, 1], error, press)


def _matched(trials: Trials, press: np.ndarray[tuple[int], np.dtype[np.str_]]) -> Errors:
    counts = trials.true_counts
    trial = np.repeat(np.arange(len(trials)), counts)
    error = np.full(len(trial), np.nan)
    pairs = trials.matched
    error[(np.cumsum(counts) - counts)[pairs.trial] + pairs.truth] = pairs.distance
    use = members(trials, "all")[trial]
    xy = np.concatenate([c.xy for c in trials.truth])[use]
    return Errors(xy[:, 0], xy[:, 1], error[use], press[trial[use]])


def _field(found: Answered) -> Field:
    keys = found.keys
    if keys.answer == "plate":
        errors = errors_of(found)
        spans = [(float(axis.min()), float(axis.max())) for axis in (errors.x, errors.y)]
        return Field(
            "tilt, deg",
            "depth, mm",
            "depth error, mm",
            (spans[0], spans[1]),
            "frames without an answer",
        )
    half = keys.workspace.half_width_mm
    gated = "" if found.single else " of matched contacts"
    return Field(
        "x, mm",
        "y, mm",
        f"location error{gated}, mm",
        ((-half, half), (-half, half)),
        "true contacts missed",
    )


def _option(row: Row, field: Field, errors: Errors) -> Option:
    edges = [np.linspace(*span, CELLS + 1) for span in field.span]
    x, y, error, press = errors.x, errors.y, errors.error, errors.press
    column, line = (
        np.clip(np.searchsorted(e, v, side="right") - 1, 0, CELLS - 1)
        for e, v in zip(edges, (x, y), strict=True)
    )
    mean: list[list[float | None]] = [[None] * CELLS for _ in range(CELLS)]
    missed: list[list[float | None]] = [[None] * CELLS for _ in range(CELLS)]
    more: list[list[tuple[object, ...]]] = [[("", "", 0, 0, 0)] * CELLS for _ in range(CELLS)]
    for j in range(CELLS):
        for i in range(CELLS):
            inside = (column == i) & (line == j)
            if inside.any():
                mean[j][i], missed[j][i], more[j][i] = _cell(error[inside], press[inside])
    middles = [((e[1:] + e[:-1]) / 2).round(4).tolist() for e in edges]
    halves = [(e[1] - e[0]) / 2 for e in edges]
    hover = (
        f"{field.x} %{{x}} ± {halves[0]:.2f}<br>{field.y} %{{y}} ± {halves[1]:.2f}<br>"
        f"<b>{field.error} %{{customdata[0]}}</b> [%{{customdata[1]}}]<br>"
        f"%{{customdata[2]}} % {field.missed}<br>%{{customdata[3]}} values, %{{customdata[4]}} "
        "presses<extra></extra>"
    )
    first = Figure(
        (_heat(middles, mean, more, hover, "mm"),), _layout(field), height=380, caption=field.error
    )
    second = Figure(
        (_heat(middles, missed, more, hover, "%"),),
        _layout(field),
        height=380,
        caption=f"{field.missed}, %",
    )
    share = float(np.isnan(error).mean())
    return Option(
        row.label,
        (first, second),
        f"Seed {row.seeds[0]}: {number(100 * share, 2)} % {field.missed}.",
    )


def _cell(
    error: FloatArray, press: np.ndarray[tuple[int], np.dtype[np.str_]]
) -> tuple[float | None, float, tuple[object, ...]]:
    """Mean error, % missed, and what is shown: text, interval, % missed, values, presses."""
    known = np.isfinite(error)
    share = round(100 * float(1 - known.mean()), 1)
    count = len(error), len(np.unique(press))
    found = mean_interval(error[known], press[known])
    if found.value is None:
        return None, share, ("n/a", "all missed", share, *count)
    ends = ("open" if e is None else number(max(e, 0.0), 4) for e in (found.low, found.high))
    shown = (number(found.value, 4), ", ".join(ends), share, *count)
    return float(f"{found.value:.4g}"), share, shown


def _heat(
    middles: Sequence[Sequence[float]],
    z: Sequence[Sequence[float | None]],
    more: object,
    hover: str,
    unit: str,
) -> Trace:
    return {
        "type": "heatmap",
        "x": middles[0],
        "y": middles[1],
        "z": z,
        "customdata": more,
        "zmin": 0,
        "zmax": _top_of(z),
        "hovertemplate": hover,
        "colorscale": "Cividis",
        "xgap": 1,
        "ygap": 1,
        "colorbar": {"title": {"text": unit}, "thickness": 12},
    }


def _top_of(z: Sequence[Sequence[float | None]]) -> float:
    """Of the scale; where all is 0, 1, so that nothing looks like something."""
    return max((value for row in z for value in row if value is not None), default=0.0) or 1.0


def _layout(field: Field) -> Mapping[str, object]:
    square = {"scaleanchor": "x", "constrain": "domain", "autorange": "reversed"}
    return {
        "xaxis": axis(field.x, constrain="domain"),
        "yaxis": axis(field.y, **(square if field.y.startswith("y") else {})),
    }
