"""The cells of a sweep as a table, with the reasons of failures below it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from rich.console import Console
from rich.text import Text

from tactibench.report.numbers import duration, plural
from tactibench.report.table import Column, table
from tactibench.report.writers.terminal import print_table
from tactibench.sweep import AXES, Cell, CellState

RIGHT = frozenset({"seed", "time"})


def print_sweep(console: Console, states: Mapping[Cell, CellState], store: Path) -> None:
    """Print every cell with its state, and the number of cells of each state.

    Args:
        console: Console to print on.
        states: The cells of the sweep.
        store: Folder of the run store.
    """
    axes = [axis for axis in AXES if any(cell.axes[axis] for cell in states)]
    rows = []
    for cell, state in states.items():
        time = "" if state.seconds is None else duration(state.seconds)
        name = "" if state.state == "to do" else state.name
        rows.append((*(cell.axes[axis] or "default" for axis in axes), state.state, time, name))
    heads = [*axes, "state", "time", "run"]
    print_table(console, table([Column(head, right=head in RIGHT) for head in heads], rows))
    for cell, state in states.items():
        if state.why:
            console.print(Text(f"{cell.label}: {state.why}"), soft_wrap=True)
    counts = Counter(state.state for state in states.values())
    parts = ", ".join(f"{count} {state}" for state, count in counts.items())
    console.print(Text(f"{plural(len(states), 'cell')}: {parts}; store {store}"), soft_wrap=True)
