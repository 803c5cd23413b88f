"""Notes on a section of a board beside its tables: test frames, simulator, code and versions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from tactibench.board import (
    TRIVIAL,
    Row,
    command_options,
    fitted_frames,
    trained_on,
    training_instances,
)
from tactibench.records import Record
from tactibench.report.document import Block, Inline, Paragraph, Prose, prose
from tactibench.report.simulator_error import first_line
from tactibench.report.table import Text


def describe_test(record: Record, shots: bool) -> list[Block]:
    """Return a note on the number of frames and presses, where another test is shown.

    Args:
        record: First record of the section.
        shots: Whether some rows were shown labelled presses of the tested sensor.

    Returns:
        [] where the protocol's own presses are tested.
    """
    tested = record.test_sensor
    if tested is None:
        return []
    frames, presses = record.data.test, tested.presses
    counted = f"{presses:,} presses"
    if frames != presses:
        counted = f"{frames:,} frames of {counted}"
    if trained_on(record):  # what it was trained on stands in the title
        fitted = _fitted_frames(record).strip()
        return [prose(fitted)] if fitted else []
    instances = training_instances(record)
    learned_from = f"{instances} sensors of the make" if instances else "the sensor itself"
    told = f"Trained on {learned_from} and tested on {counted}"
    options = command_options(record)[1:]
    parts: list[Inline] = [Prose(f"{told} of {tested.description}.")]
    if options:
        parts = [Prose(f"{told}: "), Text(options, "code"), Prose(".")]
    if shots:
        parts.append(
            Prose(" Rows with labelled presses were shown so many of it before (`--test shots=N`).")
        )
    return [Paragraph(tuple(parts))]


def _fitted_frames(record: Record) -> str:
    """Return sentences on what else was fitted to labelled frames of the tested sensor."""
    fitted = fitted_frames(record)
    if fitted is None:
        return ""
    labels = "an unknown number" if fitted.labels is None else f"{fitted.labels:,}"
    fits = [f"offset and pivot of the labels to {labels}"]
    if fitted.simulator:
        fits.insert(0, f"the simulated sensor to {fitted.simulator:,}, which test nothing")
    text = " `labelled frames besides` counts those to which something else was fitted"
    return f"{text}: {'; '.join(fits)}."


def count_scenes(record: Record) -> list[Block]:
    """Return a note on how the sensor made the test scenes, where it made them in several ways."""
    counts = record.sensor.scene_counts.get("test", {})
    counted = ", ".join(f"{count:,} {way}" for way, count in sorted(counts.items()))
    return [Paragraph((Prose("Test scenes: "), counted, Prose(".")))] if counted else []


def simulator_error(rows: Iterable[Row]) -> list[Block]:
    """Return a note on how far frames may be from finite elements; [] for older records."""
    line = first_line(record for row in rows for record in row.records)
    return [Paragraph((f"{line[0].upper()}{line[1:]}.",))] if line else []


def list_commits(runs: Sequence[Record]) -> Block:
    """Return the commits that the runs were made with, and whether files had been changed."""
    commits = Counter(record.identity.commit for record in runs)
    parts: list[Inline] = [Prose("Runs by commit of tactibench: ")]
    for k, (commit, count) in enumerate(sorted(commits.items())):
        name, plus, _ = commit.partition("+")
        changed = ", with uncommitted changes" if plus else ""
        parts += [Prose("; " if k else ""), Text(name[:10], "code"), Prose(f"{changed} ({count})")]
    return Paragraph((*parts, Prose(".")))


def missing_trivial(name: str, rows: Sequence[Row]) -> list[Block]:
    """Return a note on how to make the trivial rows that a board lacks."""
    present = {row.first.model.name for row in rows}
    absent = sorted(TRIVIAL - present)
    if trained_on(rows[0].first) or not absent:  # the board does not know where recordings lie
        return []
    asked = "".join({command_options(row.first) for row in rows})
    text = f"`tactibench run {name} --model {absent[0]}{asked}`"
    text += "".join(f", and with `--model {model}`" for model in absent[1:])
    return [prose(f"Trivial rows are missing: {text} on this sensor.")]
