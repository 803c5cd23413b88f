"""Committed records: what a board is made from, one small file a run.

``leaderboards/submissions/<protocol>/<name>.json`` is the record of a complete run without its
arrays, without the loss of every epoch, and without the sensor's description of itself, of which
the hash stays. It is a valid record all the same. ``<name>.npz`` beside it holds the answers; older
records have none.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.board.committed import (
    Arrays,
    PressErrors,
    answers_file,
    ranked_errors,
    read_press_errors,
)
from tactibench.board.labels import label_of, row_key
from tactibench.board.safe import refuse_names
from tactibench.errors import UserError
from tactibench.protocols.loader import protocol_files, read_protocol
from tactibench.records.files import atomic, read_json, write_arrays
from tactibench.records.identity import digest
from tactibench.records.record import Record, parse_record
from tactibench.records.store import CHECKSUM, StoredRun

FOLDER = "submissions"
LISTS = ("metrics", "speed")
"""Lists of a record that are written one row a line, so that a diff can be read."""


@dataclass(frozen=True)
class Added:
    """A record that was committed, and the files of the same row and seed that it replaced."""

    path: Path
    replaced: tuple[Path, ...]


def compact(record: Record) -> Record:
    """Return the record as it is committed."""
    values = record.json_values()
    identity = values["identity"]
    identity.pop(CHECKSUM, None)
    for name in ("sensor", "tested"):
        if isinstance(identity.get(name), dict):
            identity[name] = digest(identity[name])
    values["training"].pop("history", None)
    return Record.model_validate(values)


def add(run: StoredRun, board: Path) -> Added:
    """Commit a run: write its record and answers, and remove older ones of the same row and seed.

    Raises UserError for a partial run, one whose predictions are not those of its record, and one
    that no file may be called after.
    """
    refuse_partial(run.record, str(run.folder))
    refuse_names(run.record, str(run.folder))
    predicted = run.arrays("predictions")  # raises where they were changed
    record = compact(run.record)
    folder = board / FOLDER / record.protocol.id
    path = folder / f"{record.name}.json"
    same = [
        other for other in _files(folder) if other != path and slot(_read(other)) == slot(record)
    ]
    write_arrays(answers_file(path), {**predicted, **_ranked(run, predicted)})
    with atomic(path) as stream:
        stream.write(text_of(record).encode())
    for other in same:
        other.unlink()
        answers_file(other).unlink(missing_ok=True)
    return Added(path, tuple(same))


def _ranked(run: StoredRun, predicted: Arrays) -> Arrays:
    """Errors to rank by; none for a protocol that is not the present one."""
    stated = run.record.protocol
    path = protocol_files().get(stated.id)
    protocol = None if path is None else read_protocol(path)
    if protocol is None or protocol.hash != stated.hash:
        return {}
    return ranked_errors(protocol.keys, run.arrays("truth"), predicted)


def press_errors(board: Path, record: Record) -> PressErrors | None:
    """What a record is ranked by, press by press; None where no answers lie beside it."""
    place = board / FOLDER / record.protocol.id / f"{record.name}.json"
    return read_press_errors(answers_file(place))


def all_press_errors(board: Path, records: Iterable[Record]) -> dict[str, PressErrors]:
    """Of the records that have answers beside them, by name. Raises UserError for damaged ones."""
    found = ((record.name, press_errors(board, record)) for record in records)
    return {name: errors for name, errors in found if errors is not None}


def read_submissions(board: Path, protocol: str) -> list[Record]:
    """All committed records of a protocol, by name.

    Raises UserError for a file that is no valid record of a complete run of this protocol under its
    own name, and for two of the same row and seed.
    """
    records = [_read(path) for path in _files(board / FOLDER / protocol)]
    refuse_twins(records)
    return records


def refuse_twins(records: Sequence[Record]) -> None:
    """Raise UserError for two records of one row and one seed: their mean would count it twice."""
    seen: dict[str, Record] = {}
    for record in records:
        other = seen.setdefault(slot(record), record)
        if other is not record:
            raise UserError(
                f"{other.name} and {record.name} are both seed {record.seed} of "
                f"{label_of(record)}; keep one of the two files."
            )


def refuse_partial(record: Record, where: str) -> None:
    """Raise UserError for a run that was cut short."""
    if record.partial:
        raise UserError(
            f"{where} is a partial run (--quick or --limit) and has no place on a board; run the "
            "protocol whole."
        )


def slot(record: Record) -> str:
    """What there may be one record of: a row of a board and a training seed."""
    return digest([row_key(record), record.seed])


def text_of(record: Record) -> str:
    """JSON with a line for every key, and one for every metric and every time."""
    parts = []
    for name, value in record.json_values().items():
        if name in LISTS:
            rows = ",\n".join(f"  {_json(row)}" for row in value)
            parts.append(f" {_json(name)}: [\n{rows}\n ]" if rows else f" {_json(name)}: []")
        else:
            parts.append(f" {_json(name)}: {_json(value)}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _json(value: Any) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


def _files(folder: Path) -> Iterable[Path]:
    return sorted(folder.glob("*.json"))


def _read(path: Path) -> Record:
    record = parse_record(read_json(path), str(path))
    refuse_partial(record, str(path))
    if record.name != path.stem or record.protocol.id != path.parent.name:
        raise UserError(
            f"{path} holds the record {record.name!r} of protocol "
            f"{record.protocol.id!r}; file and folder must be called so."
        )
    return record


def committed_protocols(board: Path) -> Iterator[str]:
    """Protocols that have a folder of committed records."""
    place = board / FOLDER
    if place.is_dir():
        yield from sorted(path.name for path in place.iterdir() if path.is_dir())
