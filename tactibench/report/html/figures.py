"""The figures of a report: the same pictures as those of the command line."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np
from matplotlib.figure import Figure

from tactibench.board import Frontier, Row, Section, frontiers, latency, machine
from tactibench.errors import UserError
from tactibench.metrics import Trials, gospa_per_frame
from tactibench.protocols import Ranking
from tactibench.protocols.board_spec import board_spec
from tactibench.records import Record
from tactibench.report.board_page import PageSection
from tactibench.report.html.report_data import ReportBoard
from tactibench.report.numbers import fixed, number, plural, significant
from tactibench.report.plots.curve import LEARNING, curve_figure
from tactibench.report.plots.distance import (
    distance_figure,
    fitted_series,
    threshold_figure,
)
from tactibench.report.plots.doubling import doubling_figure
from tactibench.report.plots.frames import worst_frames_figure
from tactibench.report.plots.frontier import frontier_figure, off_nominal
from tactibench.report.plots.relief import relief_figure
from tactibench.report.plots.run_pictures import RunArrays
from tactibench.report.plots.stability import stability_figure
from tactibench.report.plots.style import CURVES, image_bytes
from tactibench.report.table import Cell, Column, Number, Table, Text, table

COLUMNS = 10
"""Most models beside each other in a heat map."""
WORST_ROWS, WORST = 8, 3
"""Most rows whose worst frames are shown, the best first, and number of frames of each."""
RELIEF_ROWS = 2
PAGE_DPI = 100
WITHOUT_FRAMES = (
    "Worst frames and heatmaps in relief are stored with runs, not with committed records: "
    "`tactibench run {} --model unet`, then `tactibench report --store runs`, shows them."
)
T = TypeVar("T")
MISSES = (("missed", "missed"), ("resolved", "resolved as two"), ("coverage", "answered"))
"""Shares that are shown beside every error: the first of these that a row has."""


@dataclass(frozen=True)
class Option:
    """One choice of a panel.

    Attributes:
        label: Name of the choice.
        image: The picture, as a data URI.
        numbers: Numbers behind the picture, where no table of the page has them.
        note: Words below the picture.
    """

    label: str
    image: str
    numbers: Table | None = None
    note: str = ""


MOST_PICTURES = 3
"""Most pictures of one kind and sensor. Where they cannot hold all rows, one picture of the best is
drawn: a picture takes a second or more, and nobody compares hundreds by eye."""
MOST_POINTS = 24
"""Most points beside the line of a frontier that can still be told apart."""


@dataclass(frozen=True)
class Panel:
    """A figure under a heading, of which one option is shown.

    Attributes:
        title: The heading.
        caption: How to read the figure.
        options: Options of the choice.
        ask: Name of the choice.
        folded: Whether the figure is hidden until a reader opens it, because it is behind another.
    """

    title: str
    caption: str
    options: tuple[Option, ...]
    ask: str = ""
    folded: bool = False


def panels(
    section: PageSection, board: ReportBoard, sections: Sequence[Section] = ()
) -> list[Panel]:
    """Return the figures of one sensor.

    Args:
        section: Tables of the sensor.
        board: Board of the section.
        sections: All sections of the board.
    """
    rows = [row for row in section.rows if not row.trivial]
    candidates = (
        _frontier_panel(section.section, board, sections),
        *_distance_panels(rows, board, section.title),
        _curve_panel(section, board.name),
        *_stability_panels(rows, board, section.title),
        _worst_panel(rows, board),
        _relief_panel(rows, board),
    )
    return [panel for panel in candidates if panel is not None and panel.options]


def machine_words(record: Record) -> str:
    """Return a machine in words, such as "AMD EPYC, 2 cores (2814b7530aaa)"."""
    facts = record.environment
    cores = f"{facts.cores_logical} cores" if facts.cores_logical else ""
    parts = [str(facts.cpu or "unknown"), cores, *(str(gpu) for gpu in facts.gpu)]
    return f"{', '.join(filter(None, parts))} ({machine(record)})"


def misses(row: Row) -> str:
    """Return the share that qualifies an error, such as "missed 0.17 %", or ""."""
    for metric, words in MISSES:
        for group in ("all", "0"):
            pooled = row.metric(metric, group)
            if pooled is not None:
                return f"{words} {number(100 * pooled.value, 2)}\N{NO-BREAK SPACE}%"
    return ""


def row_latency(row: Row) -> Number | None:
    """Return the p90 of one frame, ms; None where the seeds were not timed on one machine."""
    times = row.over(lambda record: latency(record, threads=1))
    if not times or len({machine(record) for record in row.records}) > 1:
        return None
    return Number(sum(times) / len(times), significant)


def _image(figure: Figure, kind: Literal["png", "svg"] = "svg") -> str:
    data = base64.b64encode(image_bytes(figure, kind, PAGE_DPI)).decode()
    return f"data:image/{'png' if kind == 'png' else 'svg+xml'};base64,{data}"


def _frontier_panel(here: Section, board: ReportBoard, sections: Sequence[Section]) -> Panel | None:
    error = board_spec(board.name).ranking
    if error is None:
        return None
    options, moved = [], False
    rows = [row for row in here.rows if not row.trivial]
    for name in sorted({machine(record) for row in rows for record in row.records}):
        regimes = [regime for regime in frontiers(rows, error, name) if regime.points]
        if regimes:
            words = machine_words(regimes[0].points[0].row.first)
            untimed = ", ".join(label for regime in regimes for label in regime.untimed)
            note = f"Without a time or an error: {untimed}." if untimed else ""
            other = off_nominal(board.name, here, sections, regimes)
            drawn = [_less_crowded(regime) for regime in regimes]
            figure = frontier_figure(drawn, error, off_nominal=other, title="")
            beaten = any(regime.dominated for regime in regimes)
            verdicts = _verdict_table(regimes, error) if beaten else None
            options.append(Option(words, _image(figure), verdicts, note))
            moved = moved or bool(other)
    caption = "Bars: 95 % over presses, of all seeds."
    if moved:
        caption += " Off-nominal: the same models where the sensor is not the nominal one."
    return Panel("Speed against error", caption, tuple(options), "timed on")


def _verdict_table(regimes: Sequence[Frontier], error: Ranking) -> Table:
    """Return a table of the points: on the frontier of their regime, or dominated by which one."""
    heads = (
        Column("model", right=False, who=True),
        Column("p90, ms"),
        Column(f"error, {error.unit}"),
    )
    rows: list[list[Cell]] = [
        [
            Text(point.label, below=regime.regime),
            Number(point.latency.value, significant),
            Number(point.error.value, fixed(error.decimals)),
            regime.verdict(point),
        ]
        for regime in regimes
        for point in regime.points
    ]
    return table((*heads, "in its regime"), rows)


def _less_crowded(regime: Frontier) -> Frontier:
    """Return the frontier with the points on its line and the best other points."""
    if len(regime.points) <= MOST_POINTS:
        return regime
    others = sorted(
        (point for point in regime.points if point not in regime.best),
        key=lambda point: point.error.value,
    )
    labels = {point.label for point in (*regime.best, *others[:MOST_POINTS])}
    return replace(regime, points=tuple(p for p in regime.points if p.label in labels))


def _distance_panels(rows: Sequence[Row], board: ReportBoard, where: str) -> Iterator[Panel]:
    series = [fitted_series(row) for row in rows]
    series = [line for line in series if len(line.resolved) > 1]
    if not series:
        return
    yield Panel(
        "Error against distance",
        "Means over seeds; bars: 95 % over presses. Hollow: less than half of the pairs were "
        "resolved, so that the error is one of few. Dashed lines: published means over all "
        "distances, of another sensor and other presses.",
        _batch_options(
            series,
            lambda part: distance_figure(part, published=board.published, measured_on=where),
        ),
        "rows",
    )
    yield Panel(
        "Seen as two",
        "Above: an unresolved pair counts its true distance. Below: share of pairs resolved "
        "(exactly two contacts predicted, both matched), and the logistic fit behind the "
        "threshold. Fits are means over seeds; where one does not cross 75 % at any tested "
        "distance, the points are joined instead.",
        _batch_options(
            series,
            lambda part: threshold_figure(part, measured_on=where),
        ),
        "rows",
    )


def _batch_options(
    rows: Sequence[T],
    draw: Callable[[Sequence[T]], Figure],
    kind: Literal["png", "svg"] = "svg",
    size: int = CURVES,
) -> tuple[Option, ...]:
    """Return a picture for every ``size`` rows, the best first, named by their places."""
    options = []
    drawn = rows if len(rows) <= MOST_PICTURES * size else rows[:size]
    for start in range(0, len(drawn), size):
        part = drawn[start : start + size]
        label = "" if len(rows) <= size else f"{start + 1} to {start + len(part)}"
        note = f"The best {len(drawn)} of {len(rows):,} rows." if len(drawn) < len(rows) else ""
        options.append(Option(label, _image(draw(part), kind), note=note))
    return tuple(options)


def _curve_panel(section: PageSection, protocol: str) -> Panel | None:
    error = board_spec(protocol).ranking
    if error is None or not section.curves:
        return None
    options = _batch_options(
        section.curves,
        lambda part: curve_figure(
            part, error, replace(LEARNING, title=""), measured_on=section.title
        ),
    )
    return Panel("Learning curve", "Bars: 95 % over presses.", options, "rows")


def _stability_panels(rows: Sequence[Row], board: ReportBoard, where: str) -> Iterator[Panel]:
    axes = board.protocol.spec.axes
    if not axes or not rows:
        return
    heat = _batch_options(
        rows,
        lambda part: doubling_figure(part, axes, title="", measured_on=where),
        size=COLUMNS,
    )
    caption = (
        "Value at which the error is twice that of the easy case; the name of a family says from "
        "where to where its cases go. Dark: doubled early. n/a: the easy case costs more than half "
        "the gate already. A model with a small error doubles it early."
    )
    yield Panel("Where the error doubles", caption, heat, "rows")
    options = _batch_options(
        rows,
        lambda part: stability_figure(part, axes, title="", measured_on=where),
        "png",
    )
    caption = (
        "Every panel is a family, from the easy case on the left to the hardest on the right. A "
        "tick marks where the error is twice that of the easy case."
    )
    yield Panel("Error case by case", caption, options, "rows", folded=True)


def _stored(rows: Sequence[Row], board: ReportBoard) -> Iterator[tuple[Row, RunArrays]]:
    """Yield the rows whose first seed is a stored run of the present protocol, with its arrays."""
    if board.protocol.spec.answer != "contacts":
        return
    for row in rows:
        run = board.runs.get(row.first.name)
        if run is not None and row.first.protocol.hash == board.protocol.hash:
            yield row, RunArrays(run, board.protocol.spec)


def _worst_panel(rows: Sequence[Row], board: ReportBoard) -> Panel:
    options = []
    for row, arrays in _stored(rows[:WORST_ROWS], board):
        try:
            options.append(_worst_frames(row, arrays))
        except (UserError, KeyError, ValueError, IndexError):
            continue  # a run with damaged arrays keeps its other figures
    caption = (
        "A ring of the tip's radius at every true contact, a cross at every predicted one. Ordered "
        "by GOSPA (p = 1), in which a miss costs half the gate."
    )
    return Panel("Worst frames", caption, tuple(options), "model")


def _worst_frames(row: Row, arrays: RunArrays) -> Option:
    """Return a picture of the worst among the frames that a run has stored."""
    frames = [int(k) for k in arrays.examples["index"]]
    test = arrays.spec.test
    trials = Trials(
        tuple(arrays.contacts[k] for k in frames),
        tuple(arrays.predicted[k] for k in frames),
        arrays.truth["press"][frames],
        tuple(str(arrays.truth["group"][k]) for k in frames),
        max_depth=arrays.spec.workspace.depth_max_mm,
        gate=test.gate_mm,
        level=test.level,
    )
    errors = gospa_per_frame(trials, 1).values
    worst = np.argsort(-errors, kind="stable")[:WORST]
    examples = [
        (f"{arrays.truth['press'][frames[k]]}: {errors[k]:.3f} mm", arrays.example(frames[k]))
        for k in worst
    ]
    note = (
        f"Seed {row.seeds[0]}, of the {len(frames)} frames that the run stored; "
        f"{len(arrays.contacts):,} were tested."
    )
    return Option(row.label, _image(worst_frames_figure(examples), "png"), note=note)


def _relief_panel(rows: Sequence[Row], board: ReportBoard) -> Panel:
    options: list[Option] = []
    for row, arrays in _stored(rows, board):
        if len(options) == RELIEF_ROWS:
            break
        try:
            seen = len(arrays.maps.get("surface", arrays.contacts))  # none where scored apart
            counts = [len(contacts) for contacts in arrays.contacts[:seen]]
            frame = int(np.argmax(counts))
            heatmap, surface = arrays.map_of(frame), arrays.map_of(frame, "surface")
            if heatmap is None:
                continue
            depth = heatmap * arrays.spec.workspace.depth_max_mm
            image = _image(relief_figure(arrays.grid, depth, surface), "png")
        except (UserError, KeyError, ValueError, IndexError):
            continue
        count = plural(counts[frame], "contact")
        note = f"Seed {row.seeds[0]}, {arrays.truth['press'][frame]}, {count}."
        options.append(Option(row.label, image, note=note))
    caption = (
        "The heatmap of a model, as scored, and the true inward displacement of the skin where the "
        "sensor knows it, on the same scale; the first test frame with the most contacts."
    )
    return Panel("Predicted heatmap in relief", caption, tuple(options), "model")
