"""Who was measured, and on what: the words that keep simulated and real numbers apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from tactibench.board.published import PublishedRow, PublishedTable, rows_for
from tactibench.records.record import Record


def label_of(record: Record) -> str:
    """Model, with its regime where there is one, as published rows are labelled."""
    return f"{record.model.name} ({record.regime})" if record.regime else record.model.name


def published_head(table: PublishedTable) -> str:
    """What a paper was measured on, such as "published: hardware TacTip ... (tactiverse 2026)"."""
    return f"published: {table.measured_on} ({table.name} {table.year})"


def published_label(row: PublishedRow) -> str:
    """Model, place in the paper, and count."""
    count = f", n {row.n:,} {row.unit}" if row.n else ""
    return f"{row.label}: {row.source.split(',')[0]}{count}"


def comparability(record: Record, published: Sequence[PublishedTable]) -> Iterable[str]:
    """Why published rows may or may not be read against this run, each reason once."""
    words = {"yes": "Comparable", "partly": "Partly comparable", "no": "Not comparable"}
    simulated = record.sensor.origin == "simulated"
    rows = [row for table in published for row in rows_for(record.protocol.id, table)]
    reasons: dict[str, None] = {}
    published_frames = record.data.published_frames
    for row in rows:
        word = words[row.comparable]
        if simulated:
            word = "Not comparable (simulated here)"
        elif row.comparable == "yes" and not published_frames:
            reasons["Not comparable: this run was not tested on the published test frames."] = None
            continue
        reasons[f"{word}: {row.note}"] = None
    return reasons


def partial_line(record: Record) -> str | None:
    """The warning of a run that was cut short; None for a whole one."""
    if not record.partial:
        return None
    why = ["quick"] if record.limits.quick else []
    if record.limits.limit is not None:
        why.append(f"limit {record.limits.limit}")
    return f"PARTIAL{' (' + ', '.join(why) + ')' if why else ''}: not for a board"


def same_question(one: Record, other: Record) -> bool:
    """Whether two different records answer the same version of a protocol, tested alike."""
    first, second = one.protocol, other.protocol
    return (
        one.name != other.name
        and one.test_sensor == other.test_sensor
        and (first.id, first.version, first.hash) == (second.id, second.version, second.hash)
    )
