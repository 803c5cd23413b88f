"""The table of ``tactibench speed --precision``: one line per arithmetic, batch and threads."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from rich.console import Console
from rich.text import Text

from tactibench.report.numbers import number
from tactibench.report.table import Column, Head, table
from tactibench.report.writers.terminal import print_table
from tactibench.run.drift import Drift, Drifts

AIM = 0.02
"""Median drift that is small beside the model's own error, as a share of it."""
ABSENT = "n/a"
HEADS = (
    "configuration",
    "batch",
    "threads",
    "median, mm",
    "largest, mm",
    "of its error",
    "other count",
    "not finite",
    "refused",
)


def print_drifts(console: Console, found: Drifts, subject: str, note: str) -> None:
    """Print how far answers lie from those in float32, and what was left out."""
    console.print(Text(subject, style="bold"))
    error = "not known" if found.error_mm is None else f"{number(found.error_mm, 4)} mm"
    console.print(Text(f"its own mean error in float32: {error}"))
    console.print(
        Text("\nanswers beside those in float32, one frame a call, on one thread", style="bold")
    )
    heads: list[Head] = [HEADS[0], *map(Column, HEADS[1:])]
    print_table(console, table(heads, cells(found.rows)))
    for name, words in {row.configuration: row.words for row in found.rows}.items():
        console.print(Text(f"{name}: {words}", style="dim"))
    for name, reason in found.skipped.items():
        console.print(Text(f"left out: {name}: {reason.rstrip('.')}", style="dim"))
    for name, reason in {r.configuration: r.reason for r in found.rows if r.reason}.items():
        console.print(Text(f"refused: {name}: {reason.rstrip('.')}", style="yellow"))
    if note:
        console.print(Text(note, style="yellow"))
    console.print(Text(f"\n{verdict(found)}"))


def cells(rows: Iterable[Drift]) -> list[tuple[str, ...]]:
    """Cells under HEADS; settings that differ in the threads alone share a line."""
    lines: dict[tuple[str, ...], list[str]] = {}
    for row in rows:
        key = (
            row.configuration,
            str(row.batch),
            length(row.apart.median_mm),
            length(row.apart.largest_mm),
            share(row.share),
            f"{row.apart.other_count} of {row.apart.frames}",
            f"{row.not_finite} of {row.outputs:,}",
            str(row.refused),
        )
        lines.setdefault(key, []).append(str(row.threads))
    return [(*key[:2], ", ".join(threads), *key[2:]) for key, threads in lines.items()]


def worst(rows: Sequence[Drift]) -> list[Drift]:
    """Of every configuration its row with the largest median drift; rows come in their order."""
    by_name = groupby(rows, key=lambda row: row.configuration)
    return [max(group, key=lambda row: row.apart.median_mm or 0.0) for _, group in by_name]


def verdict(found: Drifts) -> str:
    """Which configurations drift by more than the aim or gave numbers that are not finite."""
    bad = sum(row.not_finite for row in found.rows)
    finite = "every output is finite" if not bad else f"{bad} OUTPUTS ARE NOT FINITE"
    if found.error_mm is None:
        return f"{finite}; without an error of the model no share of it is known"
    far = [row for row in worst(found.rows) if row.share is not None and row.share > AIM]
    if not far:
        return f"{finite}; no median drift above {AIM:.0%} of the model's error"
    named = ", ".join(f"{row.configuration} ({share(row.share)})" for row in far)
    return f"{finite}; median drift above {AIM:.0%} of the model's error: {named}"


def length(value: float | None) -> str:
    """mm; powers of ten where five places say nothing."""
    if value is None:
        return ABSENT
    return number(value, 5) if value == 0 or value >= 1e-4 else f"{value:.1e}"


def share(value: float | None) -> str:
    """Per cent with two figures."""
    return ABSENT if value is None else f"{100 * value:.2g} %"
