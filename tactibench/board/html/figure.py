"""What a figure of the report is: traces and axes for Plotly, and the same numbers as a table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tactibench.board.html.inert import figure_text
from tactibench.board.palette import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
)
from tactibench.board.rows import Row

Trace = dict[str, Any]

GREY = "#808080"
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY)
"""Okabe and Ito (2008), each to be seen on white and on black; grey in place of black."""
SYMBOLS = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross", "x")
DASHES = ("solid", "dash", "dot", "dashdot")


@dataclass(frozen=True)
class Figure:
    """heads, rows: what it shows, as text. image: data URI of a picture beside it."""

    data: tuple[Trace, ...]
    layout: Mapping[str, Any]
    heads: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    height: int = 420
    image: str = ""
    caption: str = ""
    small: bool = False


@dataclass(frozen=True)
class Option:
    """One choice of a panel."""

    label: str
    figures: tuple[Figure, ...]
    note: str = ""


@dataclass(frozen=True)
class Panel:
    """Figures under one heading, of which one option is shown. ask: what is chosen."""

    title: str
    caption: str
    options: tuple[Option, ...]
    ask: str = ""


@dataclass(frozen=True)
class Look:
    """Colour by model, symbol by row, dash by regime: colour is never the only difference."""

    colour: str
    symbol: str
    dash: str


@dataclass
class Looks:
    """The looks of a protocol's rows, the same in all of its figures."""

    rows: Sequence[Row]
    _found: dict[str, Look] = field(default_factory=dict)

    def __post_init__(self) -> None:
        models = sorted({str(row.first.model.name) for row in self.rows})
        regimes = sorted({row.regime for row in self.rows}, reverse=True)
        counts: dict[str, int] = {}
        for row in self.rows:
            model = models.index(str(row.first.model.name))
            nth = counts[row.label] = counts.get(row.label, len(counts))
            self._found.setdefault(
                row.label,
                Look(
                    COLOURS[model % len(COLOURS)],
                    SYMBOLS[nth % len(SYMBOLS)],
                    DASHES[regimes.index(row.regime) % len(DASHES)],
                ),
            )

    def of(self, row: Row) -> Look:
        return self._found[row.label]


def rounded(values: Iterable[float | None], digits: int = 5) -> list[float | None]:
    """Fewer digits than anybody can see in a figure; what is not finite becomes None."""
    return [None if v is None or not math.isfinite(v) else float(f"{v:.{digits}g}") for v in values]


def lines(*texts: str) -> str:
    """Hover text: the first line bold; all of it is shown as it is."""
    first, *others = (figure_text(text) for text in texts if text)
    return "<br>".join([f"<b>{first}</b>", *others])


def axis(title: str, **more: Any) -> dict[str, Any]:
    return {"title": {"text": title}, "automargin": True, **more}


def log_axis(title: str, values: Iterable[float], **more: Any) -> dict[str, Any]:
    """Logarithmic, with numbers at 1, 2 and 5 times every power of ten that the values span."""
    known = [value for value in values if value > 0]
    low, high = math.log10(min(known)), math.log10(max(known))
    few = high - low < 2.5
    ticks = [
        k * 10.0**n
        for n in range(math.floor(low) - 1, math.ceil(high) + 1)
        for k in ((1, 2, 5) if few else (1,))
    ]
    if high - low < 0.4:  # so close that fewer would be seen than two
        ticks = sorted({*ticks, *(float(f"{value:.2g}") for value in known)})
    pad = 0.06 * (high - low) + 0.03
    return axis(
        title,
        type="log",
        tickmode="array",
        tickvals=ticks,
        ticktext=[f"{tick:.10g}" for tick in ticks],
        range=[round(low - pad, 4), round(high + pad, 4)],
        **more,
    )


def bars(
    values: Sequence[float | None], lows: Sequence[float | None], highs: Sequence[float | None]
) -> dict[str, Any]:
    """Error bars up and down; an end that is not known has none."""
    up = [0.0 if v is None or h is None else h - v for v, h in zip(values, highs, strict=True)]
    down = [0.0 if v is None or w is None else v - w for v, w in zip(values, lows, strict=True)]
    return {
        "type": "data",
        "symmetric": False,
        "array": rounded(up),
        "arrayminus": rounded(down),
        "thickness": 1.2,
        "width": 3,
    }
