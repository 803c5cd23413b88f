"""Speed against error, a choice of regime and machine: a point is a row of the board."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from tactibench.board.frontier import Frontier, Point, Range, frontiers
from tactibench.board.html.figure import (
    GREY,
    Figure,
    Looks,
    Option,
    Panel,
    Trace,
    lines,
    log_axis,
    rounded,
)
from tactibench.board.html.inert import figure_text
from tactibench.board.html.words import beside, machine_words, seeds_words, with_interval
from tactibench.board.numbers import significant
from tactibench.board.ranking import RankingError
from tactibench.board.rows import Row, machine

CAPTION = (
    "p90 of one frame to contacts on one thread against the error that orders the board; bars: "
    "95 % over presses, of all seeds. Hollow: dominated beyond the intervals. Dashed: the least "
    "error within a time. Times are compared inside one machine only."
)


def frontier_panel(rows: Sequence[Row], error: RankingError, looks: Looks) -> Panel | None:
    """None where no row was timed."""
    options = list(_options(rows, error, looks))
    if not options:
        return None
    return Panel("Speed against error", CAPTION, tuple(options), "trained in regime, timed on")


def _options(rows: Sequence[Row], error: RankingError, looks: Looks) -> Iterator[Option]:
    machines = sorted({machine(record) for row in rows for record in row.records})
    for name in machines:
        for found in frontiers(rows, error, name):
            if found.points:
                words = machine_words(found.points[0].row.first)
                note = f"Without a time or an error: {', '.join(found.untimed)}." * bool(
                    found.untimed
                )
                yield Option(f"{found.regime}, {words}", (_figure(found, error, looks),), note)


def _figure(found: Frontier, error: RankingError, looks: Looks) -> Figure:
    points = [_point(point, found, error, looks) for point in found.points]
    heads = ("model", "p90, ms", f"{error.name}, {error.unit}", "beside the error", "verdict")
    rows = tuple(
        (
            p.label,
            significant(p.latency.value),
            with_interval(p.error.value, p.error.low, p.error.high, error.decimals),
            beside(p.row),
            found.verdict(p),
        )
        for p in found.points
    )
    layout = {
        "xaxis": log_axis("one frame to contacts, p90, ms", _ends(p.latency for p in found.points)),
        "yaxis": log_axis(f"{error.name}, {error.unit}", _ends(p.error for p in found.points)),
    }
    return Figure((_steps(found), *points), layout, heads, rows, height=460)


def _ends(ranges: Iterable[Range]) -> list[float]:
    """An interval may reach 0, which no logarithm does: it is cut at the edge."""
    return [end for one in ranges for end in (one.low, one.value, one.high) if end > 0]


def _point(point: Point, found: Frontier, error: RankingError, looks: Looks) -> Trace:
    look, x, y = looks.of(point.row), point.latency, point.error
    hollow = point.label in found.dominated
    value = with_interval(y.value, y.low, y.high, error.decimals)
    text = lines(
        point.row.label,
        f"{error.name}: {value} {error.unit}",
        beside(point.row),
        f"p90: {significant(x.value)} ms [{significant(x.low)}, {significant(x.high)}]",
        seeds_words(point.row),
        found.verdict(point),
        machine_words(point.row.first),
    )
    return {
        "type": "scatter",
        "mode": "markers",
        "name": figure_text(point.label),
        "x": rounded([x.value]),
        "y": rounded([y.value]),
        "error_x": _bar(x.value, x.low, x.high, look.colour),
        "error_y": _bar(y.value, y.low, y.high, look.colour),
        "marker": {
            "color": look.colour,
            "size": 11,
            "line": {"width": 1.6},
            "symbol": look.symbol + ("-open" if hollow else ""),
        },
        "hoverinfo": "text",
        "hovertext": [text],
    }


def _bar(value: float, low: float, high: float, colour: str) -> Trace:
    return {
        "type": "data",
        "symmetric": False,
        "array": rounded([high - value]),
        "arrayminus": rounded([value - low]),
        "color": colour,
        "thickness": 1.2,
        "width": 3,
    }


def _steps(found: Frontier) -> Trace:
    """The least error that is reached within a time."""
    x = [point.latency.value for point in found.best]
    y = [point.error.value for point in found.best]
    right = max(point.latency.high for point in found.points)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": rounded([*x, right]),
        "y": rounded([*y, *y[-1:]]),
        "line": {"shape": "hv", "dash": "dash", "width": 1.4, "color": GREY},
        "hoverinfo": "skip",
        "showlegend": False,
    }
