"""The table of ``tactibench doctor --determinism``: what came out the same, with its hash."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.text import Text

from tactibench.report.table import table
from tactibench.report.writers.terminal import print_table
from tactibench.run.repeated import Finding

SHOWN = 12
"""Figures of a hash."""
HEADS = ("model", "what", "times", "same", "sha256")


def print_findings(console: Console, found: Sequence[Finding], subject: str) -> None:
    """Print one line per thing, and where bits differ one per time."""
    console.print(Text(subject, style="bold"))
    print_table(console, table(HEADS, _lines(found)))
    console.print(Text(f"\n{verdict(found)}"))


def verdict(found: Sequence[Finding]) -> str:
    """One sentence."""
    other = [f"{row.model}: {row.what}" for row in found if not row.same]
    if not other:
        return "the same bits every time"
    return f"NOT THE SAME: {'; '.join(other)}"


def _lines(found: Iterable[Finding]) -> Iterable[tuple[str, ...]]:
    for row in found:
        times = str(len(row.hashes))
        if row.same:
            yield row.model, row.what, times, "yes", next(iter(row.hashes.values()))[:SHOWN]
            continue
        yield row.model, row.what, times, "NO", ""
        for time, value in row.hashes.items():
            yield "", "", "", "", f"{value[:SHOWN]} {time}"
