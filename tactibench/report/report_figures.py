"""The figures of a report: the same pictures as those of the command line."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np
from matplotlib.figure import Figure

from tactibench.board import Row, frontiers, machine
from tactibench.errors import UserError
from tactibench.metrics import Trials, gospa_per_frame
from tactibench.protocols import board_spec
from tactibench.report.board_pages import PageSection, machine_words
from tactibench.report.curve_plots import LEARNING, curve_figure, stability_figure
from tactibench.report.distance_plot import distance_figure, distance_series
from tactibench.report.frame_plots import worst_frames_figure
from tactibench.report.frontier_plot import frontier_figure, unseen_frontiers
from tactibench.report.plot_data import frontier_table
from tactibench.report.run_pictures import RunArrays
from tactibench.report.style import CURVES, image_bytes
from tactibench.report.tables import Table

if TYPE_CHECKING:
    from tactibench.report.html_report import ReportBoard

WORST_ROWS, WORST = 8, 3
"""Most rows whose worst frames are shown, the best first, and number of frames of each."""
PAGE_DPI = 100
MOST_PICTURES = 3
"""Most pictures of one kind and sensor. Where they cannot hold all rows, one picture of the best is
drawn: a picture takes a second or more, and nobody compares hundreds by eye."""
T = TypeVar("T")


@dataclass(frozen=True)
class Option:
    """One choice of a panel.

    Attributes:
        label: Name of the choice.
        image: The picture, as a data URI.
        tables: Numbers behind the picture, where no table of the page has them.
        note: Words below the picture.
    """

    label: str
    image: str
    tables: tuple[Table, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Panel:
    """A figure under a heading, of which one option is shown.

    Attributes:
        title: The heading.
        caption: How to read the figure.
        options: Options of the choice.
        ask: Name of the choice.
    """

    title: str
    caption: str
    options: tuple[Option, ...]
    ask: str = "rows"


def panels(part: PageSection, board: ReportBoard) -> list[Panel]:
    """Return the figures of one sensor.

    Args:
        part: Tables of the sensor.
        board: Board of the section.
    """
    return [panel for panel in _all_panels(part, board) if panel.options]


def _all_panels(part: PageSection, board: ReportBoard) -> Iterator[Panel]:
    rows = [row for row in part.rows if not row.trivial]
    error, axes, where = board_spec(board.name).ranking, board.protocol.spec.axes, part.title
    caption = (
        "Bars: 95 % over presses, of all seeds. Beside them the same models on sensors that no "
        "training saw."
    )
    yield Panel("Speed against error", caption, _frontiers(part, board), "timed on")
    series = [line for line in map(distance_series, rows) if len(line.resolved) > 1]
    yield Panel(
        "Error against distance",
        "Means over seeds; bars: 95 % over presses. Hollow: less than half of the pairs were "
        "resolved, so that the error is one of few. Dashed lines: published means over all "
        "distances, of another sensor and other presses. Below: share of pairs resolved (exactly "
        "two contacts predicted, both matched); the large mark is the threshold.",
        _options(series, partial(distance_figure, published=board.published, measured_on=where)),
    )
    if error is not None:
        untitled = replace(LEARNING, title="")
        draw = partial(curve_figure, error=error, caption=untitled, measured_on=where)
        yield Panel("Learning curve", "Bars: 95 % over presses.", _options(part.curves, draw))
    if axes:
        yield Panel(
            "Error case by case",
            "Every panel is a family, from the easy case on the left to the hardest on the right. "
            "A tick marks where the error is twice that of the easy case.",
            _options(
                rows, partial(stability_figure, axes=axes, title="", measured_on=where), "png"
            ),
        )
    yield Panel(
        "Worst frames",
        "A ring of the tip's radius at every true contact, a cross at every predicted one. Ordered "
        "by GOSPA (p = 1), in which a miss costs half the gate.",
        tuple(_worst_frames(rows[:WORST_ROWS], board)),
        "model",
    )


def _image(figure: Figure, kind: Literal["png", "svg"] = "svg") -> str:
    data = base64.b64encode(image_bytes(figure, kind, PAGE_DPI)).decode()
    return f"data:image/{'png' if kind == 'png' else 'svg+xml'};base64,{data}"


def _options(
    rows: Sequence[T],
    draw: Callable[[Sequence[T]], Figure],
    kind: Literal["png", "svg"] = "svg",
    *,
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


def _frontiers(part: PageSection, board: ReportBoard) -> tuple[Option, ...]:
    """Return a picture for every machine that timed rows."""
    error = board_spec(board.name).ranking
    rows, options = [row for row in part.rows if not row.trivial], []
    if error is None:
        return ()
    for name in sorted({machine(record) for row in rows for record in row.records}):
        regimes = [regime for regime in frontiers(rows, error, name) if regime.points]
        if regimes:
            words = f"{machine_words(regimes[0].points[0].row.first)} ({name})"
            untimed = ", ".join(label for regime in regimes for label in regime.untimed)
            note = f"Without a time or an error: {untimed}." if untimed else ""
            unseen = unseen_frontiers(board.name, part.section, regimes)
            figure = frontier_figure(regimes, error, unseen=unseen, title="")
            tables = tuple(frontier_table(regime, error) for regime in regimes)
            options.append(Option(words, _image(figure), tables, note))
    return tuple(options)


def _worst_frames(rows: Sequence[Row], board: ReportBoard) -> Iterator[Option]:
    """Yield the worst of the frames that were stored with the first seed of every row."""
    spec = board.protocol.spec
    for row in rows if spec.answer == "contacts" else ():
        run = board.runs.get(row.first.name)
        if run is None:
            continue
        try:
            arrays = RunArrays(run, spec)
            frames = [int(k) for k in arrays.examples["index"]]
            trials = Trials(
                tuple(arrays.contacts[k] for k in frames),
                tuple(arrays.predicted[k] for k in frames),
                arrays.truth["press"][frames],
                tuple(str(arrays.truth["group"][k]) for k in frames),
                max_depth=spec.workspace.depth_max_mm,
                gate=spec.test.gate_mm,
                level=spec.test.level,
            )
            errors = gospa_per_frame(trials, 1).values
            examples = [
                (f"{trials.press[k]}: {errors[k]:.3f} mm", arrays.example(frames[k]))
                for k in np.argsort(-errors, kind="stable")[:WORST]
            ]
            image = _image(worst_frames_figure(examples), "png")
        except (UserError, KeyError, ValueError, IndexError):
            continue  # a run with damaged arrays keeps its other figures
        note = (
            f"Seed {row.seeds[0]}, of the {len(frames)} frames that the run stored; "
            f"{len(arrays.contacts):,} were tested."
        )
        yield Option(row.label, image, note=note)
