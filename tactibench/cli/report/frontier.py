"""The table of ``tactibench plot frontier``."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich.console import Console
from rich.text import Text

from tactibench.board.frontier import Frontier, Range
from tactibench.board.numbers import number, significant
from tactibench.board.ranking import RankingError
from tactibench.cli.report.cells import Cells, aligned, print_grid


def print_frontiers(
    console: Console, found: Sequence[Frontier], error: RankingError, subject: str
) -> None:
    """Print one line per point, regime by regime, and what was left out."""
    console.print(Text(f"Speed against {error.name}", style="bold"))
    console.print(Text(subject, style="cyan"), soft_wrap=True)
    for one in found:
        _print(console, one, error)
    for text in remarks(found):
        console.print(Text(text), soft_wrap=True)


def _print(console: Console, found: Frontier, error: RankingError) -> None:
    console.print()
    times = aligned([_range(p.latency, significant) for p in found.points])
    errors = aligned([_range(p.error, lambda v: number(v, error.decimals)) for p in found.points])
    rows: list[Cells] = [
        (point.label, str(len(point.row.records)), time, value, found.verdict(point))
        for point, time, value in zip(found.points, times, errors, strict=True)
    ]
    heads = (
        f"regime {found.regime}",
        "seeds",
        "p90 and range, ms",
        f"error and range, {error.unit}",
        "",
    )
    print_grid(console, heads, rows, right=frozenset({"seeds"}))


def remarks(found: Sequence[Frontier]) -> list[str]:
    """What the table leaves out, one sentence each."""
    texts = [
        "",
        "Range: from the lowest end of the seeds' intervals to the highest; a time is at "
        "least 2 % wide. Dominated: another of the same regime is better on both by more than "
        "the ranges. Trivial rows are left out.",
    ]
    elsewhere = sum(one.elsewhere for one in found)
    if elsewhere:
        texts.append(
            f"Left out: {elsewhere:,} runs that were timed on another machine than "
            f"{found[0].machine}."
        )
    untimed = [f"{name} ({one.regime})" for one in found for name in one.untimed]
    if untimed:
        texts.append(f"Left out, without an error or a time: {'; '.join(untimed)}.")
    return texts


def _range(value: Range, text: Callable[[float], str]) -> str:
    return f"{text(value.value)} [{text(value.low)}, {text(value.high)}]"
