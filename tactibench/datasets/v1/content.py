"""What a data set's folder holds: read as it is, checked line by line."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.datasets.v1.header import Header, read_header
from tactibench.datasets.v1.journal import Lines, read_lines
from tactibench.datasets.v1.layout import EVENTS, JOURNAL
from tactibench.datasets.v1.rows import read_row
from tactibench.datasets.v1.sample import Sample
from tactibench.errors import UserError


@dataclass(frozen=True)
class Content:
    """Header, samples in the order they were written, events, and the journals as they stand."""

    header: Header
    samples: tuple[Sample, ...]
    events: tuple[Mapping[str, Any], ...]
    journal: Lines
    event_lines: Lines

    @property
    def journal_sha256(self) -> str:
        """Of the whole lines of metadata.jsonl."""
        return journal_hash(self.journal)


def read_content(folder: Path) -> Content:
    """Read header and journals; nothing is changed.

    Raises UserError with file and line for what is damaged (but a torn last line), for an id that
    stands twice, and for a closed data set whose journal was changed.
    """
    header = read_header(folder)
    journal = read_lines(folder / JOURNAL)
    if header.status == "closed":
        _check_closed(folder, header, journal)
    samples: dict[int, int] = {}
    found = []
    for number, line in enumerate(journal.whole, start=1):
        where = f"{folder / JOURNAL} line {number}"
        sample = read_row(line, where)
        first = samples.setdefault(sample.id, number)
        if first != number:
            raise UserError(
                f"{folder / JOURNAL} lines {first} and {number} are both of id {sample.id}; an id "
                "stands once: remove one of them."
            )
        found.append(sample)
    events = read_lines(folder / EVENTS)
    return Content(header, tuple(found), _events(folder, events), journal, events)


def journal_hash(journal: Lines) -> str:
    """sha256 of the whole lines."""
    return hashlib.sha256(b"".join(line + b"\n" for line in journal.whole)).hexdigest()


def _check_closed(folder: Path, header: Header, journal: Lines) -> None:
    if journal.torn or journal_hash(journal) != header.journal_sha256:
        raise UserError(
            f"{folder / JOURNAL} is not what it was when the data set was closed; restore it "
            f"(`tactibench data verify {folder}` says what is wrong)."
        )


def _events(folder: Path, lines: Lines) -> tuple[Mapping[str, Any], ...]:
    whole = enumerate(lines.whole, start=1)
    return tuple(event_of(line, f"{folder / EVENTS} line {number}") for number, line in whole)


def event_of(line: bytes, where: str) -> Mapping[str, Any]:
    """The event of a line. Raises UserError, which begins with ``where``."""
    try:
        event = json.loads(line)
    except (ValueError, RecursionError):
        event = None
    if not isinstance(event, dict):
        raise UserError(f"{where} is no JSON object; restore it.")
    return event
