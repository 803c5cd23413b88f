"""The cells of a sweep as a table, with the reasons of failures below it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from tactibench.report.numbers import duration, plural
from tactibench.report.table import Column, Table, table
from tactibench.report.writers.terminal import print_table
from tactibench.sweep import AXES, CellResult, DatasetTask

STATES = {"done": "in the store", "to do": "to do", "cannot": "failed"}
RIGHT = frozenset({"seed", "time"})


def print_sweep(
    console: Console, finished: Sequence[CellResult], sets: Sequence[DatasetTask], store: Path
) -> None:
    """Print every cell and every data set with its state, and the number of cells of each state.

    Args:
        console: Console to print on.
        finished: Results of the cells.
        sets: Data sets of the sweep.
        store: Folder of the run store.
    """
    if sets:
        print_table(console, _set_table(sets))
    if not finished:
        return
    print_table(console, _cell_table(finished))
    for result in finished:
        if result.why:
            console.print(Text(f"{result.cell.label}: {result.why}"), soft_wrap=True)
    console.print(Text(f"{_counts(finished)}; store {store}"), soft_wrap=True)


def _set_table(sets: Sequence[DatasetTask]) -> Table:
    rows = [
        (
            task.label,
            f"{task.samples:,}",
            task.source.identity["name"],
            "complete" if task.is_complete else "to do",
        )
        for task in sets
    ]
    return table(("data set", Column("samples"), "sensor", "state"), rows)


def _cell_table(finished: Sequence[CellResult]) -> Table:
    axes = [axis for axis in AXES if any(result.cell.axes[axis] for result in finished)]
    rows = []
    for result in finished:
        time = "" if result.outcome is None else duration(result.outcome.seconds)
        settings = (result.cell.axes[axis] or "default" for axis in axes)
        rows.append((*settings, _state(result), time, result.name))
    heads = [*axes, "state", "time", "run"]
    return table([Column(head, right=head in RIGHT) for head in heads], rows)


def _state(result: CellResult) -> str:
    if result.why:
        return "failed"
    return STATES[result.plan.state] if result.outcome is None else "run"


def _counts(finished: Sequence[CellResult]) -> str:
    """Return the number of cells by state, such as "6 cells: 4 run, 1 in the store, 1 failed"."""
    states = [_state(result) for result in finished]
    parts = [f"{states.count(state)} {state}" for state in dict.fromkeys(states)]
    return f"{plural(len(finished), 'cell')}: {', '.join(parts)}"
