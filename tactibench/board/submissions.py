"""Committed records, from which a board is made: one small file a run.

``leaderboards/submissions/<protocol>/<name>.json`` is the record of a complete run without its
arrays, without the loss of every epoch, and without the sensor's description of itself, of which
the hash stays. It is a valid record all the same. ``<name>.npz`` beside it holds the predictions;
older records have none. A record of a stranger is not trusted: its names must be plain names, and
its texts must be printable.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy.typing as npt

from tactibench.board.grouping import row_key
from tactibench.board.predictions import (
    Arrays,
    PressErrors,
    answers_file,
    ranked_errors,
    read_press_errors,
)
from tactibench.board.rows import label_of
from tactibench.errors import UserError
from tactibench.protocols import (
    protocol_files,
    recorded_version,
    unknown_protocol,
)
from tactibench.records import (
    CHECKSUM,
    Component,
    Record,
    StoredRun,
    atomic,
    digest,
    parse_json,
    parse_record,
    read_json,
    refuse_changed,
    with_checksum,
    write_arrays,
)

FOLDER = "submissions"
LISTS = ("metrics", "speed")
"""Lists of a record that are written one row a line, so that a diff can be read."""


@dataclass(frozen=True)
class Submission:
    """A committed record.

    Attributes:
        path: File of the record.
        replaced: Files of the same row and seed that it replaced.
    """

    path: Path
    replaced: tuple[Path, ...]


def compact(record: Record) -> Record:
    """Return the record as it is committed.

    Notes on how a training was resumed are left out: they concern the machine that trained, and may
    name a folder of it.
    """
    values = record.json_values()
    identity = values["identity"]
    identity.pop(CHECKSUM, None)
    for name in ("sensor", "tested"):
        if isinstance(identity.get(name), dict):
            identity[name] = digest(identity[name])
    values["training"].pop("history", None)
    values["training"].get("notes", {}).pop("checkpoint", None)
    return Record.model_validate(values)


def add(run: StoredRun, board: Path) -> Submission:
    """Commit a run: write its record and answers, and remove older ones of the same row and seed.

    Args:
        run: Stored run.
        board: Folder of the board.

    Raises:
        UserError: The run is partial, its predictions are not those of its record, or its record
            holds a name or text that a committed record may not have.
    """
    refuse_partial(run.record, str(run.folder))
    refuse_names(run.record, str(run.folder))
    predicted = run.arrays("predictions")  # raises where they were changed
    record = Record.model_validate(with_checksum(compact(run.record).json_values()))
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
    return Submission(path, tuple(same))


def _ranked(run: StoredRun, predicted: Arrays) -> Arrays:
    """Return the errors to rank by."""
    stated = run.record.protocol
    protocol = recorded_version(stated.label, stated.hash, str(run.folder))
    return ranked_errors(protocol.spec, run.arrays("truth"), predicted)


def press_errors(board: Path, record: Record) -> PressErrors | None:
    """Return the errors that rank a record, press by press; None where no answers lie beside it."""
    place = board / FOLDER / record.protocol.id / f"{record.name}.json"
    return read_press_errors(answers_file(place))


def all_press_errors(board: Path, records: Iterable[Record]) -> dict[str, PressErrors]:
    """Return the errors of all records that have predictions, by the name of the record.

    Raises:
        UserError: A file of predictions is damaged.
    """
    # Records of one test set name the same presses; these names are held in memory once.
    names: dict[bytes, npt.NDArray[Any]] = {}
    by_name = {}
    for record in records:
        errors = press_errors(board, record)
        if errors is not None:
            press = names.setdefault(errors.press.tobytes(), errors.press)
            by_name[record.name] = replace(errors, press=press)
    return by_name


def read_submissions(board: Path, protocol: str) -> list[Record]:
    """Return all committed records of a protocol, sorted by the name of the file.

    Raises:
        UserError: A file is no valid record of a complete run of this protocol, in its present
            version, under its own name; or two records are of the same row and seed.
    """
    records = [_read(path) for path in _files(board / FOLDER / protocol)]
    versions = {(record.protocol.label, record.protocol.hash): record.name for record in records}
    for (label, content_hash), name in versions.items():
        recorded_version(label, content_hash, name)
    refuse_twins(records)
    return records


def refuse_twins(records: Sequence[Record]) -> None:
    """Raise UserError for two records of one row and seed: a mean would count the seed twice."""
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
    """Return the key of a row and a training seed, which have one record."""
    return digest([row_key(record), record.seed])


def text_of(record: Record) -> str:
    """Return JSON with one line for every key, every metric and every time."""
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
    values = read_json(path)
    record = parse_record(values, str(path))
    refuse_changed(values, str(path))
    refuse_partial(record, str(path))
    refuse_misplaced(record, path)
    _share_keys(record)
    return record


def _share_keys(record: Record) -> None:
    """Keep the set of keys that rows of a record were read with once, not once a row.

    Such sets take three quarters of the memory of a board. The rows are not changed afterwards.
    """
    key_sets: dict[frozenset[str], set[str]] = {}
    for row in (*record.metrics, *record.speed):
        keys = row.__pydantic_fields_set__
        shared = key_sets.setdefault(frozenset(keys), keys)
        object.__setattr__(row, "__pydantic_fields_set__", shared)


def refuse_misplaced(record: Record, path: Path) -> None:
    """Raise UserError unless file and folder have the names of the record and its protocol."""
    if record.name != path.stem or record.protocol.id != path.resolve().parent.name:
        raise UserError(
            f"{path} holds the record {record.name!r} of protocol "
            f"{record.protocol.id!r}; file and folder must be called so."
        )


def committed_protocols(board: Path) -> Iterator[str]:
    """Yield the protocols that have a folder of committed records."""
    place = board / FOLDER
    if place.is_dir():
        yield from sorted(path.name for path in place.iterdir() if path.is_dir())


NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9_-]|\.(?!\.)){0,159}")
"""Form of the name of a run, model, encoder or sensor, which is part of file names and pages."""
LONGEST = 1000
"""Most characters of a text in a record; the longest in committed records has 188."""
LARGEST = 2**20
"""Most bytes of a record; the largest committed one has 25 kB."""


MOST_VALUES = 50_000
"""Most values in a record; the longest committed one has 9,700."""
DEEPEST = 12
"""Most lists and objects inside each other; the deepest committed record has 7."""
LARGEST_NUMBER = 2.0**63
"""Largest number in a record: a seed has 63 bits, and next in size are operations of a model."""


def read_untrusted(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file of at most LARGEST bytes.

    Raises:
        UserError: The file is missing, no plain file or too large, holds no JSON object, or holds
            too many values, too deep ones, or a number that is too large or not finite.
    """
    try:
        size = path.stat().st_size
        if path.is_symlink() or not path.is_file():
            raise UserError(f"{path} is no plain file.")
        if size > LARGEST:
            raise UserError(
                f"{path} has {size:,} bytes, more than the {LARGEST:,} that a record may take; "
                "a committed record holds no arrays and no history."
            )
        value = parse_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UserError(f"{path} does not exist.") from None
    except (ValueError, RecursionError, OSError) as error:
        raise UserError(f"{path} cannot be read as JSON: {error}.") from None
    if not isinstance(value, dict):
        raise UserError(f"{path} holds a {type(value).__name__}, not a record.")
    _refuse_extremes(value, str(path))
    return value


def _refuse_extremes(value: Any, where: str) -> None:
    """Raise UserError for more values, deeper lists or larger numbers than a record has."""
    level, count, depth = [value], 0, 0
    while level:
        count, depth = count + len(level), depth + 1
        if count > MOST_VALUES or depth > DEEPEST:
            raise UserError(
                f"{where} holds more than {MOST_VALUES:,} values, or lists more than {DEEPEST} "
                "deep; a committed record holds no arrays and no history."
            )
        if any(isinstance(item, int | float) and abs(item) > LARGEST_NUMBER for item in level):
            raise UserError(f"{where} holds a number beyond {LARGEST_NUMBER:g}.")
        containers = [
            item.values() if isinstance(item, dict) else item
            for item in level
            if isinstance(item, dict | list)
        ]
        level = [inner for item in containers for inner in item]


def refuse_names(record: Record, where: str) -> None:
    """Raise UserError for a name with markup or a path in it, or a text that is not printable.

    Args:
        record: A record that is valid otherwise (see ``parse_record``).
        where: Name of the record in messages.
    """
    for key, name in _names(record):
        if not NAME.fullmatch(name):
            raise UserError(
                f"{where}: {key} is {name[:80]!r}; a name may hold letters, digits, '.', '_' and "
                "'-' only, at most 160, so that it is neither markup nor a path."
            )
    for key, text in _texts(record.json_values()):
        if len(text) > LONGEST or not text.isprintable():
            raise UserError(
                f"{where}: {key} holds a text of {len(text):,} characters that is too long or not "
                f"printable; a text has at most {LONGEST:,} and no control characters."
            )
    tested = [] if record.test_sensor is None else [("sensor.tested", record.test_sensor)]
    for kind, component in (*_components(record), *tested):
        for key, value in component.parameters.items():
            if isinstance(value, str) and re.search(r"[/\\<>]", value):
                raise UserError(
                    f"{where}: {kind}.{key} is {value[:80]!r}; a committed run must not depend on "
                    "a path, nor hold markup."
                )


def _components(record: Record) -> Iterator[tuple[str, Component]]:
    yield "model", record.model
    yield "sensor", record.sensor
    if record.encoder is not None:
        yield "encoder", record.encoder


def _names(record: Record) -> Iterator[tuple[str, str]]:
    yield "name", record.name
    yield "regime", record.regime
    yield "protocol.id", record.protocol.id
    for kind, component in _components(record):
        yield f"{kind}.name", component.name
        yield from ((f"{kind}.parameters", name) for name in component.parameters)
    if record.test_sensor is not None:
        yield "sensor.tested.name", record.test_sensor.name
        yield from (("sensor.tested.parameters", name) for name in record.test_sensor.parameters)
    yield from (("identity.plugins", name) for name in record.identity.plugins)
    yield from (("training.notes", name) for name in record.training.notes)
    yield from (("environment.versions", name) for name in record.environment.versions)


def _texts(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield the key and the text of all strings in a JSON value."""
    if isinstance(value, str):
        yield key, value
    elif isinstance(value, Mapping):
        for name, inner in value.items():
            yield f"{key}.{name}".lstrip("."), str(name)
            yield from _texts(inner, f"{key}.{name}".lstrip("."))
    elif isinstance(value, list):
        for inner in value:
            yield from _texts(inner, key)


def records_of(board: Path, protocol: str) -> list[Record]:
    """Return the committed records of a protocol.

    Raises:
        UserError: The protocol is unknown, there is no board, or a committed record is invalid.
    """
    files = protocol_files()
    if protocol not in files:
        raise unknown_protocol(protocol, files)
    check_folder(board)
    return read_submissions(board, protocol)


def check_folder(board: Path) -> None:
    """Raise UserError where there is no board."""
    if not board.is_dir():
        raise UserError(
            f"there is no board in {board}; name another folder with --board DIR (a checkout of "
            f"tactibench has leaderboards), or begin a board of your own: `mkdir {board}`."
        )
