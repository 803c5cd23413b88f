"""Learning curves: error against training presses, both logarithmic."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.ticker import (
    FixedLocator,
    LogLocator,
    NullFormatter,
    NullLocator,
    StrMethodFormatter,
)

from tactibench.board.curve import Curve, counts
from tactibench.board.figures.style import figure, headline, plain, save, series_look

DODGE = 0.012
"""Between the curves, as a share of the presses, so that bars stand beside each other."""
DASHES = ("-", (0, (5, 2)), (0, (1, 1.5)))
"""Of the first seven curves, the next seven, and so on."""


def learning_curves(
    path: Path, found: Sequence[Curve], *, error: str, title: str = "", measured_on: str = ""
) -> None:
    """Draw every curve with its 95 % intervals over presses. error: its name with the unit."""
    made = figure(8.0, 5.2)
    axes = made.subplots()
    middle = (len(found) - 1) / 2
    for k, curve in enumerate(found):
        known = [(step, step.error) for step in curve.steps if step.error is not None]
        x = [step.presses * (1 + DODGE * (k - middle)) for step, _ in known]
        y = [pooled.value for _, pooled in known]
        low = [p.value - (p.value if p.low is None else p.low) for _, p in known]
        high = [(p.value if p.high is None else p.high) - p.value for _, p in known]
        axes.errorbar(
            x,
            y,
            [low, high],
            **series_look(k),
            markersize=5.5,
            linestyle=DASHES[k // 7 % 3],
            linewidth=1.5,
            elinewidth=1.1,
            capsize=2.5,
            label=curve.label,
        )
    axes.set(xscale="log", yscale="log", xlabel="presses that the model learned from", ylabel=error)
    axes.xaxis.set_major_locator(FixedLocator(counts(found) or [1000]))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5)))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    plain(axes)
    if found:
        made.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    headline(made, title, measured_on)
    save(made, path)
