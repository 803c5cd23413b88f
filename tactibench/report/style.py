"""Size, colours and marks of all pictures, and how a figure becomes PNG or SVG.

The colours are those of Okabe and Ito (2008), which colour-blind readers can tell apart; yellow is
left out, because it vanishes on white. A model keeps its colour and its mark in every picture and
page. A figure is drawn on a canvas and in a style of its own: neither ``MPLBACKEND`` nor a
matplotlibrc of the user, whose settings were made for other pictures, has a say.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any, Literal, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import AutoLocator, LogLocator, NullFormatter, StrMethodFormatter

from tactibench.records import atomic
from tactibench.report.tables import Table

BLACK = "#000000"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#595959"
SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES = ("-", (0, (5, 2)), (0, (1, 1.5)), (0, (5, 1.5, 1, 1.5)))
"""Line styles of the first row of a model in a picture, the second, and so on."""
GUEST_COLOURS = ("#882255", "#44AA99", "#999933", "#332288", "#AA4499", "#661100")
GUEST_MARKERS = ("p", "h", "*", "d", "8", "H")
"""Colours (of Tol's muted scheme) and marks of other models than MODELS."""
MODELS = ("unet", "superpose", "vgnn", "mixture", "cnn", "pins", "kernel")
"""Models in the order of SERIES; colour and mark of any other follow from its name."""
TRIVIAL = {"nearest": (GREY, "<"), "mean": (GREY, ">")}
CURVES = 6
"""Most curves in one panel: more could not be told apart."""
HEAT = "cividis"
"""Perceptually uniform, and the same to readers with and without colour blindness."""
DPI = 150
LONGEST_LABEL = 48
STYLE: dict[str, Any] = {"svg.fonttype": "none", "svg.hashsalt": "tactibench"}
"""Settings that differ from matplotlib's defaults."""
ENVIRONMENT = frozenset({"backend", "backend_fallback", "interactive", "toolbar", "timezone"})
"""Settings of the user's screen, which no picture depends on."""
Given = ParamSpec("Given")


@dataclass(frozen=True)
class Look:
    """Colour, marker and line of a row, so that colour is never the only difference.

    Attributes:
        color: Colour of marks and line.
        marker: Marker, in matplotlib's terms.
        line: Line style, in matplotlib's terms.
    """

    color: str
    marker: str
    line: Any = "-"

    @property
    def points(self) -> dict[str, Any]:
        """Arguments of matplotlib for marks."""
        return {"color": self.color, "marker": self.marker}


def model_look(model: str) -> Look:
    """Return the look of a model, which is the same in all pictures."""
    if model in TRIVIAL:
        return Look(*TRIVIAL[model])
    if model in MODELS:
        k = MODELS.index(model)
        return Look(SERIES[k], MARKERS[k])
    colour, marker = hashlib.sha256(model.encode()).digest()[:2]
    guests = len(GUEST_COLOURS)
    return Look(GUEST_COLOURS[colour % guests], GUEST_MARKERS[marker % guests])


def row_looks(models: Sequence[str]) -> list[Look]:
    """Return a look for every row of a picture; rows of one model differ in marker and line.

    Args:
        models: Name of the model of every row.
    """
    looks = []
    for k, model in enumerate(models):
        look, before = model_look(model), models[:k].count(model)
        if before:
            marks = MARKERS if look.marker in MARKERS else GUEST_MARKERS
            marker = marks[(marks.index(look.marker) + before) % len(marks)]
            look = Look(look.color, marker, DASHES[before % len(DASHES)])
        looks.append(look)
    return looks


def own_style() -> AbstractContextManager[None]:
    """Return a context in which matplotlib has its own defaults and those of this module."""
    settings: Any = {k: v for k, v in mpl.rcParamsDefault.items() if k not in ENVIRONMENT}
    settings.update(STYLE)
    return mpl.rc_context(settings)


def in_own_style(draw: Callable[Given, Figure]) -> Callable[Given, Figure]:
    """Return a function that draws as ``draw`` does, whatever the user's settings are."""

    @wraps(draw)
    def drawn(*args: Given.args, **kwargs: Given.kwargs) -> Figure:
        with own_style():
            return draw(*args, **kwargs)

    return drawn


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, sizes in inches at 150 dpi, that belongs to no global state."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.set(h_pad=0.08, w_pad=0.06)  # type: ignore[call-arg]  # of this engine, not of its base
    FigureCanvasAgg(figure)
    return figure


def plain(axes: Axes) -> None:
    """Show two spines only, and a faint grid behind the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#DDDDDD", linewidth=0.6)
    axes.set_axisbelow(True)


class _Multiples(LogLocator):
    def tick_values(self, vmin: float, vmax: float) -> Any:
        ticks = np.asarray(super().tick_values(vmin, vmax))
        several = ((vmin <= ticks) & (ticks <= vmax)).sum() > 1
        return ticks if several else AutoLocator().tick_values(vmin, vmax)


def log_ticks(axis: Any, subs: Sequence[float] = (1, 2, 5)) -> None:
    """Label a logarithmic axis with values, not powers, at the multiples ``subs`` of a decade.

    An axis that shows fewer than two of these has evenly spaced values, so that it can be read.
    """
    axis.set_major_locator(_Multiples(subs=subs))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def headline(figure: Figure, title: str, *details: str) -> None:
    """Write a title and, below it, a line with the details of the measurement."""
    detail = "; ".join(filter(None, details))
    if title or detail:
        text = "\n".join(filter(None, (title, detail))).replace("$", r"\$")
        figure.suptitle(text, fontsize=10, x=0.01, ha="left")


def legend_below(figure: Figure, columns: int, handles: Any = None, labels: Any = None) -> None:
    """Draw a legend below all panels.

    Args:
        figure: The figure.
        columns: Number of columns of the legend.
        handles: Marks of the legend; None: those of the panels.
        labels: Labels of the legend; None: those of the panels.
    """
    given = {"handles": handles, "labels": labels}
    given = {name: value for name, value in given.items() if value is not None}
    figure.legend(**given, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)


def legend_mark(label: str, **look: Any) -> Line2D:
    """Return a mark for a legend."""
    return Line2D([], [], linestyle="none", label=label, **look)


def short_label(text: str, longest: int = LONGEST_LABEL) -> str:
    """Return a name as a picture shows it: on one line, cut off if too long, no formula."""
    line = " ".join(text.split())
    line = line if len(line) <= longest else f"{line[: longest - 1]}…"
    return line.replace("$", r"\$")


def save_png(figure: Figure, path: Path) -> None:
    """Write a PNG of 256 colours, a third of the bytes, under a temporary name; then rename it."""
    from PIL import Image

    picture = Image.open(io.BytesIO(image_bytes(figure, "png"))).convert("RGB")
    with atomic(path) as stream:
        picture.quantize(256, dither=Image.Dither.NONE).save(stream, "PNG", optimize=True)


def image_bytes(figure: Figure, kind: Literal["png", "svg"], dpi: int = DPI) -> bytes:
    """Return the bytes of a figure's file. The same figure gives the same bytes."""
    stream = io.BytesIO()
    metadata = {"Software": None} if kind == "png" else {"Date": None, "Creator": None}
    with own_style():
        figure.savefig(stream, format=kind, dpi=dpi, metadata=metadata)
    return stream.getvalue()


def draw_line(
    axes: Axes,
    x: Sequence[float],
    errors: Sequence[tuple[float, float | None, float | None]],
    look: Look,
    label: str = "",
    **sizes: float,
) -> None:
    """Draw values with the bars of their intervals, connected in the look of a row.

    Args:
        axes: Where to draw.
        x: Places of the values.
        errors: Value, low and high end; an end that is not known has no bar.
        look: Colour, marker and line.
        label: Name in the legend.
        sizes: Line and marker sizes other than the usual ones.
    """
    down = [value - (value if low is None else low) for value, low, _ in errors]
    up = [(value if high is None else high) - value for value, _, high in errors]
    usual: dict[str, Any] = {"linewidth": 1.6, "elinewidth": 1.1, "capsize": 2.5, "markersize": 5.5}
    axes.errorbar(
        x,
        [value for value, _, _ in errors],
        [down, up],
        linestyle=look.line,
        label=label,
        **(usual | sizes),
        **look.points,
    )


def first_rows(count: int) -> tuple[str, ...]:
    """Return the sentence about a picture that shows fewer than ``count`` rows; () if all."""
    return (f"The picture shows the first {CURVES} rows.",) if count > CURVES else ()


@dataclass(frozen=True)
class PlotData:
    """A figure, drawn on request, with its numbers.

    Attributes:
        subject: Protocol, sensor and machine.
        tables: The numbers, as a reader sees them.
        rows: The numbers, one mapping a point.
        draw: Draws the figure.
        remarks: Sentences on how to read the numbers, and what they leave out.
    """

    subject: str
    tables: tuple[Table, ...]
    rows: list[dict[str, Any]] = field(repr=False)
    draw: Callable[[], Figure] = field(repr=False)
    remarks: tuple[str, ...] = ()
