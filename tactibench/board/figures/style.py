"""What all pictures share: size, colours that colour-blind readers tell apart, an atomic write."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tactibench.board.palette import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SERIES,
    SKY,
    VERMILION,
)
from tactibench.records.files import atomic

__all__ = [
    "BLACK",
    "BLUE",
    "DPI",
    "GREEN",
    "GREY",
    "HEAT",
    "MARKERS",
    "ORANGE",
    "PURPLE",
    "SERIES",
    "SKY",
    "VERMILION",
    "figure",
    "headline",
    "plain",
    "save",
    "series_look",
    "spread",
]

DPI = 150
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
"""One for each colour: colour is never the only difference."""
HEAT = "cividis"
"""Perceptually uniform, and the same to readers with and without colour blindness."""


def series_look(k: int) -> dict[str, Any]:
    """Colour and marker of the k-th series: 49 pairs, of which the first 7 share neither."""
    return {"color": SERIES[k % 7], "marker": MARKERS[(k + k // 7) % 7]}


def figure(width: float, height: float) -> Figure:
    """Make an empty figure, inches at 150 dpi, that belongs to no global state."""
    made = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    engine = made.get_layout_engine()
    if engine is not None:
        engine.set(h_pad=0.08, w_pad=0.06)  # type: ignore[call-arg]  # of this engine, not of its base
    FigureCanvasAgg(made)
    return made


def plain(axes: Axes) -> None:
    """Two spines and a faint grid behind the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#DDDDDD", linewidth=0.6)
    axes.set_axisbelow(True)


def headline(made: Figure, title: str, detail: str) -> None:
    """Put a title and, below it, the line that says what was measured on what."""
    if title or detail:
        made.suptitle("\n".join(filter(None, (title, detail))), fontsize=10, x=0.01, ha="left")


def save(made: Figure, path: Path) -> None:
    """Write a PNG under a temporary name, then rename it. The same figure gives the same bytes."""
    with atomic(path) as stream:
        made.savefig(stream, format="png", metadata={"Software": None})


def spread(positions: list[float], least: float) -> list[float]:
    """Move positions apart, in their order, until neighbours differ by at least ``least``.

    The middle of a group that had to be moved stays where it was.
    """
    order = np.argsort(positions, kind="stable")
    blocks: list[tuple[list[float], int]] = []  # wanted starts of the block's first label, size
    for wanted in np.asarray(positions, dtype=np.float64)[order]:
        starts, size = [float(wanted)], 1
        while blocks and np.mean(blocks[-1][0]) + blocks[-1][1] * least > np.mean(starts):
            before, count = blocks.pop()
            starts = before + [start - count * least for start in starts]
            size += count
        blocks.append((starts, size))
    moved = [float(np.mean(starts)) + k * least for starts, size in blocks for k in range(size)]
    out = [0.0] * len(positions)
    for place, value in zip(order, moved, strict=True):
        out[place] = value
    return out
