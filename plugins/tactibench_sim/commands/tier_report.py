"""Speed against error of the tiers, as a table and as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from rich.console import Console
from rich.measure import Measurement
from rich.segment import Segments
from rich.table import Table
from rich.text import Text

from tactibench.geometry import DOME_RADIUS_MM
from tactibench.lab import atomic
from tactibench_sim.commands.tier_errors import (
    APART,
    AXES,
    DEPTHS_MM,
    GROUPS,
    TARGET_US,
    TARGETS_MM,
    TERMS,
    Errors,
    TierErrors,
    pin_name,
    pooled,
)

SERIES = (
    ("#0072B2", "o"),
    ("#D55E00", "s"),
    ("#009E73", "^"),
    ("#CC79A7", "D"),
    ("#E69F00", "v"),
    ("#56B4E9", "P"),
    ("#000000", "X"),
)
"""Colours of Okabe and Ito (2008), each with its own mark."""
GREY = "#595959"
_DPI = 200
_UNLIMITED = 1000


def print_report(console: Console, tiers: Sequence[TierErrors]) -> None:
    """Print errors by tier and group, the worst case of each tier, and the speeds."""
    heads = [head for deepest in DEPTHS_MM for head in ("n", f"d <= {deepest:g} mm")]
    table = _table(("tier", "scenes"), (*heads, "pin tip", "normal, deg"))
    for tier in tiers:
        label = tier.name  # in the first row of a tier only
        for group in GROUPS:
            errors = tier.errors_in(group, max(DEPTHS_MM))
            if not errors:
                continue
            cells = [cell for deepest in DEPTHS_MM for cell in _cells(tier, group, deepest)]
            cells += [_pair(errors, "tip", 3), _pair(errors, "normal", 1)]
            table.add_row(label, group, *cells)
            label = ""
    console.print(
        Text("pin bases against finite elements, tips of R = 3 mm, mm: max / median", style="bold")
    )
    _print(console, table)
    for tier in tiers:
        for line in _remarks(tier):
            console.print(Text(line), soft_wrap=True)
    for axis, facts in AXES.items():
        head = f"the same by term and {axis}, {facts.unit}, tips of all radii: max / median (n)"
        console.print(Text(head, style="bold"))
        _print(console, _term_table(tiers, axis))
    speeds = _table(("tier", "term"), ("wall", "processor", "scenes/s"))
    for tier in tiers:
        label = tier.name
        for term, cost in tier.costs.items():
            per_second = f"{1e6 / cost.processor:,.0f}"
            speeds.add_row(label, term, f"{cost.wall:,.1f}", f"{cost.processor:,.1f}", per_second)
            label = ""
    console.print(Text("field of a scene, 127 pins, one thread, us", style="bold"))
    _print(console, speeds)


def _term_table(tiers: Sequence[TierErrors], axis: str) -> Table:
    """Return the errors of every term, one column a band; terms without a scene are left out."""
    bands = AXES[axis].bands()
    table = _table(("tier", "term"), [name for name, _, _ in bands])
    for tier in tiers:
        label = tier.name
        for term in TERMS:
            inside = [tier.errors_of(term, axis, low, high) for _, low, high in bands]
            if any(inside):
                cells = [
                    f"{_pair(errors, 'base', 3)} ({len(errors)})" if errors else ""
                    for errors in inside
                ]
                table.add_row(label, term, *cells)
                label = ""
    return table


def _table(left: Sequence[str], right: Sequence[str]) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    for heads, justify in ((left, "left"), (right, "right")):
        for head in heads:
            table.add_column(head, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    return table


def _print(console: Console, table: Table) -> None:
    """Print at the natural width: a narrow terminal breaks lines, nothing is cut."""
    natural = Measurement.get(console, console.options.update_width(_UNLIMITED), table).maximum
    segments = console.render(table, console.options.update_width(natural))
    console.print(Segments(segments), crop=False, end="")


def _cells(tier: TierErrors, group: str, deepest: float) -> tuple[str, str]:
    inside = tier.errors_in(group, deepest)
    return str(len(inside)), _pair(inside, "base", 3)


def _pair(errors: Sequence[Errors], quantity: str, digits: int) -> str:
    if not errors:
        return "n/a"
    values = pooled(errors, quantity)
    return f"{values.max():.{digits}f} / {np.median(values):.{digits}f}"


def _remarks(tier: TierErrors) -> list[str]:
    remarks = []
    for group, deepest in product(APART, DEPTHS_MM):
        if not tier.errors_in(group, deepest):
            continue
        errors, pin = tier.worst(group, deepest)
        where = ", ".join(f"{v:+.1f}" for v in DOME_RADIUS_MM * errors.scene.directions[pin, :2])
        remarks.append(
            f"{tier.name}, {group}, d <= {deepest:g} mm: worst {errors.base[pin]:.3f} mm in "
            f"{errors.scene.label}, {pin_name(pin)} (x, y {where} mm)"
        )
    if tier.refused:
        named = ", ".join(scene.label for scene in tier.refused)
        remarks.append(f"{tier.name} refused {len(tier.refused)}: {named}")
    return remarks


def draw(path: Path, tiers: Sequence[TierErrors], title: str) -> None:
    """Write a PNG: error against processor time of a scene, a panel for each depth range."""
    figure = Figure(figsize=(9.0, 4.6), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(DEPTHS_MM), sharex=True, sharey=True)
    times = [tier.speed.processor for tier in tiers] + [TARGET_US]
    for axes, deepest in zip(panels, DEPTHS_MM, strict=True):
        _panel(axes, tiers, deepest)
        axes.set_xlim(min(times) / 3, max(times) * 4)
        axes.set_xlabel("processor time of the field of a dual scene, µs", fontsize=9)
    panels[0].set_ylabel("error of a pin base, mm (filled: max, open: median)", fontsize=9)
    series = zip(tiers, SERIES, strict=False)
    marks = [
        Line2D([], [], color=colour, marker=mark, label=tier.name)
        for tier, (colour, mark) in series
    ]
    figure.legend(
        handles=marks, loc="outside lower center", ncols=len(marks), frameon=False, fontsize=9
    )
    figure.suptitle(title, fontsize=10, x=0.01, ha="left")
    with atomic(path) as stream:
        figure.savefig(stream, format="png", metadata={"Software": None})


def _panel(axes: Axes, tiers: Sequence[TierErrors], deepest: float) -> None:
    axes.set(xscale="log", yscale="log")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(which="major", color="#E4E4E4", linewidth=0.6)
    axes.set_axisbelow(True)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_minor_formatter(NullFormatter())
    shown = 0
    for tier, (colour, mark) in zip(tiers, SERIES, strict=False):
        inside = tier.errors_in("all", deepest)
        if not inside:
            continue
        shown = max(shown, len(inside))
        base = pooled(inside, "base")
        x, high, middle = tier.speed.processor, float(base.max()), float(np.median(base))
        axes.plot([x, x], [middle, high], color=colour, linewidth=1)
        axes.plot(x, high, mark, color=colour, markersize=7)
        axes.plot(x, middle, mark, color=colour, markersize=7, markerfacecolor="white")
    axes.set_title(f"depth up to {deepest:g} mm, {shown} scenes", fontsize=10, loc="left")
    for kind, value in TARGETS_MM[deepest].items():
        axes.axhline(value, color=GREY, linewidth=1, linestyle="--" if kind == "max" else ":")
        axes.annotate(
            f"target {kind} {value:.2f} mm",
            (0.99, value),
            (0, 2),
            color=GREY,
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            ha="right",
            fontsize=8,
        )
    axes.axvline(TARGET_US, color=GREY, linewidth=1, linestyle="-.")
    axes.annotate(
        f"target {TARGET_US:g} µs",
        (TARGET_US, 0),
        (3, 3),
        color=GREY,
        fontsize=8,
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        rotation=90,
    )
