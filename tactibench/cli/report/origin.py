"""Who was measured, and on what: the words that keep simulated and real numbers apart."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tactibench.board.labels import tested_of
from tactibench.board.published import PublishedRow, PublishedTable, rows_for

Record = Mapping[str, Any]


def label_of(record: Record) -> str:
    """Model, with its regime where there is one, as published rows are labelled."""
    regime = record.get("regime")
    return f"{record['model']['name']} ({regime})" if regime else str(record["model"]["name"])


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
    simulated = record["sensor"]["origin"] == "simulated"
    rows = [row for table in published for row in rows_for(record["protocol"]["id"], table)]
    reasons: dict[str, None] = {}
    published_frames = record["data"].get("published_frames", False)
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
    if not record["partial"]:
        return None
    limits = record.get("limits") or {}
    why = ["quick"] if limits.get("quick") else []
    if limits.get("limit") is not None:
        why.append(f"limit {limits['limit']}")
    return f"PARTIAL{' (' + ', '.join(why) + ')' if why else ''}: not for a board"


def same_question(one: Record, other: Record) -> bool:
    """Whether two different records answer the same version of a protocol, tested alike."""
    asked = ("id", "version", "hash")
    return (
        one["name"] != other["name"]
        and tested_of(one) == tested_of(other)
        and all(one["protocol"][key] == other["protocol"][key] for key in asked)
    )
