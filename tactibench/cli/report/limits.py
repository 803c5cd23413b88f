"""The table of ``tactibench plot limit``."""

from __future__ import annotations

import math
from typing import Any

from rich.console import Console
from rich.text import Text

from tactibench.board.limits import LimitMaps, summary
from tactibench.cli.report.cells import Cells, aligned, print_grid

HEADS = ("depth, mm", "sd of", "middle", "median", "90 %", "worst", "at x, y mm", "presses")


def print_limits(console: Console, maps: LimitMaps, subject: str) -> None:
    """Print one line per depth and quantity; below it what has no bound and what is refused."""
    lines = summary(maps)
    columns = [
        aligned([micrometres(line.get(name)) for line in lines])
        for name in ("middle", "median", "p90", "worst")
    ]
    cells: list[Cells] = []
    last = None
    for line, *values in zip(lines, *columns, strict=True):
        depth = "" if line["depth"] == last else f"{line['depth']:g}"
        cells.append((depth, line["quantity"], *values, _place(line), f"{line['n']:,}"))
        last = line["depth"]
    console.print(Text("Cramer-Rao bound: smallest standard deviation, um", style="bold"))
    console.print(Text(subject, style="cyan"), soft_wrap=True)
    print_grid(console, HEADS, cells, right=frozenset({"presses"}))
    for text in remarks(maps, lines):
        console.print(Text(text), soft_wrap=True)


def micrometres(value: float | None) -> str:
    """mm as um with three digits: "0.834", "12.9", "1,480"; "inf" without a bound."""
    if value is None or math.isnan(value):
        return "n/a"
    if math.isinf(value):
        return "inf"
    micro = 1000 * value
    return f"{micro:,.0f}" if micro >= 999.5 else f"{micro:#.3g}"


def remarks(maps: LimitMaps, lines: list[dict[str, Any]]) -> list[str]:
    """What the numbers leave out, one sentence each."""
    per_depth = lines[:: len(maps.request.quantities)]
    unbounded, refused = (
        sum(line[state] for line in per_depth) for state in ("unbounded", "refused")
    )
    of = f"of {maps.request.presses:,} presses"
    found = []
    if len(maps.request.indenter.offsets) > 1:
        found.append("x, y, depth: of the worse of the two tips.")
    if unbounded:
        found.append(f"{unbounded:,} {of} have no bound, since a tip leaves no trace.")
    if refused:
        found.append(f"{refused:,} {of} are refused: {maps.refusal}")
    return found


def _place(line: dict[str, Any]) -> str:
    if "worst_at" not in line:
        return ""
    x, y = line["worst_at"]
    return f"{x:+.1f}, {y:+.1f}"
