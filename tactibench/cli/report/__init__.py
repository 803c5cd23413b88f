"""What a researcher reads after a run: errors with intervals, misses, published rows, speed.

Every section says what it was measured on. All tables fit 80 columns; a wider terminal gets the
counts as columns instead of words.
"""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from tactibench.board.labels import measured_on
from tactibench.board.published import PublishedTable, rows_for
from tactibench.cli.report.hard_cases import print_hard_cases
from tactibench.cli.report.origin import (
    comparability,
    label_of,
    partial_line,
    same_question,
)
from tactibench.cli.report.speed import print_speed
from tactibench.cli.report.tables import print_block, print_others
from tactibench.cli.report.words import BLOCKS, EXPLAIN
from tactibench.protocols.families import Axis
from tactibench.records.record import Record

__all__ = ["print_record"]

OTHERS = 6
"""More stored runs than these would hide the run itself."""


def print_record(
    console: Console,
    record: Record,
    published: Sequence[PublishedTable],
    others: Sequence[Record] = (),
    axes: Sequence[Axis] = (),
    *,
    path: str,
) -> None:
    """Print one record beside published rows and ``others``, stored runs. path: of its file.

    Of the others only those of the same version of the protocol are shown, the first six. axes: of
    the families of hard cases that it is about.
    """
    protocol = record.protocol.id
    blocks = BLOCKS.get(protocol, ())
    comparable = [other for other in others if same_question(other, record)]
    _heading(console, record)
    if axes:
        print_hard_cases(console, record, axes)
    for block in blocks:
        print_block(console, block, record, published, comparable[:OTHERS])
    if len(comparable) > OTHERS:
        hidden = len(comparable) - OTHERS
        console.print(Text(f"{hidden} more stored runs of {protocol} are not shown", style="dim"))
    notes = [EXPLAIN[protocol]] if protocol in EXPLAIN else []
    if any(rows_for(protocol, table) for table in published):
        notes += comparability(record, published)
    for note in notes:
        console.print(Text(note, style="dim"))
    print_others(console, record, blocks)
    print_speed(console, record, published)
    console.print()
    _warning(console, record)
    console.print(Text(record.signature), soft_wrap=True)  # one line, to be copied whole
    console.print(Text(f"record: {path}"), soft_wrap=True)


def _heading(console: Console, record: Record) -> None:
    protocol, encoder, data = record.protocol, record.encoder, record.data
    console.print(Text(f"{protocol.id}  {protocol.title}", style="bold"))
    parts = (
        label_of(record),
        f"encoder {encoder.name}" if encoder else "no encoder",
        measured_on(record),
        f"seed {record.seed}",
    )
    console.print(Text(", ".join(parts)))
    rejected = f"; {data.rejected:,} rejected by geometry" if data.rejected else ""
    test = record.test_sensor
    again = test is not None and test.presses != data.test
    frames = f"frames of {test.presses:,} " if test and again else ""
    console.print(
        Text(
            f"{data.train:,} training, {data.validation:,} validation, "
            f"{data.test:,} test {frames}presses{rejected}"
        )
    )
    training = record.training
    if training.epochs:
        when = "weights reused, trained" if training.reused else "trained"
        console.print(
            Text(
                f"{when} {training.epochs} epochs on {training.presses:,} "
                f"presses in {_duration(training.seconds or 0.0)}"
            )
        )
    _warning(console, record)


def _warning(console: Console, record: Record) -> None:
    if line := partial_line(record):
        console.print(Text(line, style="bold red"))


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{seconds:.1f} s"
