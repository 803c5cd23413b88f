"""The records of one sensor, out of a board's and a run store's."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from tactibench.board.boards import records_of
from tactibench.board.labels import trained_for
from tactibench.board.sections import Section, sections_of
from tactibench.board.submissions import slot
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols.loader import protocol_files, read_protocol
from tactibench.records.record import Record
from tactibench.records.store import stored_runs


def gathered(protocol: str, board: Path, runs: Path | None) -> list[Record]:
    """Committed records of the present version of a protocol, and complete runs of a store.

    Of one row and seed the newest run is taken. Runs that were tested on something else than they
    were trained for belong to tables of their own and are left out. Raises UserError.
    """
    found: dict[str, Record] = {slot(record): record for record in records_of(board, protocol)}
    stored = [run.record for run in stored_runs(runs)] if runs is not None else []
    for record in sorted(stored, key=lambda record: (record.created, record.name)):
        if record.protocol.id == protocol and not record.partial:
            found[slot(record)] = record
    asked = read_protocol(protocol_files()[protocol]).hash
    return trained_for(r for r in found.values() if r.protocol.hash == asked)


def of_sensor(records: Iterable[Record], sensor: str | None, protocol: str) -> Section:
    """The section of one sensor: called so, or that of most runs, nominal ones first.

    Raises UserError where there is none.
    """
    sections = sections_of(records)
    if not sections:
        raise UserError(
            f"there is no complete run of {protocol}; add some with `tactibench board add`, or "
            "name a run store with --runs."
        )
    if sensor is None:
        least = min(section.kind for section in sections)
        return max((s for s in sections if s.kind == least), key=_runs)
    names = [section.sensor.text() for section in sections]
    fitting = [s for s, name in zip(sections, names, strict=True) if name == sensor]
    if not fitting:
        raise UserError(
            f"no run of {protocol} is on a sensor {sensor!r}; {did_you_mean(sensor, names)}"
        )
    return max(fitting, key=_runs)


def left_out(records: Sequence[Record], section: Section) -> int:
    """Runs on other sensors."""
    return len(records) - _runs(section)


def _runs(section: Section) -> int:
    return sum(len(row.records) for row in section.rows)
