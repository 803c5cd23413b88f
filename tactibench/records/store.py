"""The run store: one folder per run, complete or absent.

The answers of a run are stored before they are scored, in a hidden folder beside the run's own. So
no computed answer is lost where scoring fails.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy.typing as npt

from tactibench.errors import UserError, did_you_mean
from tactibench.records.files import (
    arrays_hash,
    locked,
    read_arrays,
    read_json,
    write_arrays,
    write_json,
)
from tactibench.records.identity import digest
from tactibench.records.record import Record, parse_record

RECORD = "record.json"
CHECKSUM = "sealed"
"""Key of a record's identity: the digest of everything else in the record. It shows changes made by
accident. Somebody who changes a record on purpose can write a new digest; ``tactibench verify``
detects that."""
BEFORE = ".before"
"""Suffix of the folder of a run that is being replaced, until the new run has its place."""
ANSWERS = ".answers"
"""Suffix of the hidden folder of a run whose answers are stored and not scored yet."""
PARTS = ("truth", "predictions", "maps", "times", "examples")
"""Arrays beside a record: truth and predictions of every frame, heatmaps, raw call times, and a few
test frames for pictures."""

Arrays = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class StoredRun:
    """A run on disk.

    Attributes:
        folder: Folder of the run.
        record: Contents of its ``record.json``.
    """

    folder: Path
    record: Record

    def arrays(self, part: str) -> Arrays:
        """Return the arrays of one of PARTS, verified against the record.

        Raises:
            UserError: The file is missing, damaged, or not what the record was made from.
        """
        path = self.folder / f"{part}.npz"
        arrays = read_arrays(path)
        if arrays_hash(arrays) != self.record.identity.stored.get(part):
            raise UserError(f"{path} is not what its record was made from; run the protocol again.")
        return arrays


def write_run(store: Path, record: Record, parts: Mapping[str, Arrays]) -> StoredRun:
    """Store a run as a whole: its name appears in the store once everything is written.

    A run of the same name is replaced.

    Args:
        store: Folder of the run store.
        record: Record of the run, with its metrics.
        parts: Arrays, by the names of PARTS.

    Raises:
        UserError: The record breaks an invariant.
    """
    answers = write_answers(store, record, parts)
    return complete_run(answers, answers.record)


def write_answers(store: Path, record: Record, parts: Mapping[str, Arrays]) -> StoredRun:
    """Store the arrays of a run with its record, hidden until ``complete_run`` shows the run.

    Args:
        store: Folder of the run store.
        record: Record of the run; it may lack the metrics.
        parts: Arrays, by the names of PARTS.

    Raises:
        UserError: The record breaks an invariant; nothing is written.
    """
    stored = {name: arrays_hash(parts[name]) for name in PARTS}
    values = record.json_values()
    values["identity"]["stored"] = stored
    values = with_checksum(values)
    record = parse_record(values, f"the record of {record.name}")
    folder = store / record.name
    answers, temporary = (_beside(folder, suffix) for suffix in (ANSWERS, ".made"))
    with held_name(store, record.name):
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        try:
            for name in PARTS:
                write_arrays(temporary / f"{name}.npz", parts[name])
            write_json(temporary / RECORD, values)
            shutil.rmtree(answers, ignore_errors=True)
            temporary.rename(answers)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    return StoredRun(answers, record)


def held_name(store: Path, name: str) -> AbstractContextManager[None]:
    """Return a lock on the name of a run: two processes that make one run take turns."""
    return locked(_beside(store / name, ".lock"))


def unscored_run(store: Path, name: str) -> StoredRun | None:
    """Return the stored answers of a run that is not scored yet; None without readable ones."""
    return _readable(_beside(store / name, ANSWERS))


def complete_run(answers: StoredRun, record: Record) -> StoredRun:
    """Give stored answers the final record of their run, and show the run under its name.

    A run of the same name is replaced.

    Raises:
        UserError: The record breaks an invariant, and the answers stay where they are; or another
            process stored the run meanwhile, and the answers are gone.
    """
    values = with_checksum(record.json_values())
    record = parse_record(values, f"the record of {record.name}")
    folder = answers.folder.with_name(record.name)
    before = _beside(folder, BEFORE)
    with held_name(folder.parent, record.name):
        if not answers.folder.is_dir():
            raise UserError(
                f"the answers of {record.name} are gone, because another process stored the run "
                "meanwhile; show it with `tactibench score`."
            )
        _put_back(before, folder)
        write_json(answers.folder / RECORD, values)
        try:
            if folder.exists():
                folder.rename(before)
            answers.folder.rename(folder)
        finally:
            _put_back(before, folder)
    return StoredRun(folder, record)


def open_run(store: Path, name: str) -> StoredRun:
    """Open a run by its name in the store, its folder, or its record file.

    Raises:
        UserError: There is no such run, its record cannot be read or is invalid, or it was changed.
    """
    _repair(store)
    given = Path(name)
    folder = given.parent if given.name == RECORD else given
    if not (folder / RECORD).is_file():
        folder = store / name
    if not (folder / RECORD).is_file():
        names = [run.folder.name for run in stored_runs(store)]
        near = did_you_mean(name, names) if names else "it holds no run yet."
        raise UserError(f"there is no run {name!r} in {store}; {near}")
    return _opened(folder)


def readable_run(store: Path, name: str) -> StoredRun | None:
    """Return the run of this name; None where there is none or it cannot be read."""
    _repair(store)
    return _readable(store / name)


def run_names(store: Path) -> list[str]:
    """Return the names of all runs in a store, sorted, whether they can be read or not."""
    if not store.is_dir():
        return []
    _repair(store)
    names = sorted(path.name for path in store.iterdir())
    return [name for name in names if name[0] != "." and (store / name / RECORD).is_file()]


def stored_runs(store: Path) -> Iterator[StoredRun]:
    """Yield the readable runs of a store, sorted by name; unreadable ones are left out."""
    for name in run_names(store):
        run = _readable(store / name)
        if run is not None:
            yield run


def _readable(folder: Path) -> StoredRun | None:
    try:
        return _opened(folder) if (folder / RECORD).is_file() else None
    except UserError:
        return None


def _opened(folder: Path) -> StoredRun:
    path = folder / RECORD
    values = read_json(path)
    record = parse_record(values, str(path))
    refuse_changed(values, str(path))
    return StoredRun(folder, record)


def with_checksum(values: dict[str, Any]) -> dict[str, Any]:
    """Return a record with the digest of everything else in it."""
    identity = {name: value for name, value in values["identity"].items() if name != CHECKSUM}
    checksum = digest({**values, "identity": identity})
    return {**values, "identity": {**identity, CHECKSUM: checksum}}


def refuse_changed(values: dict[str, Any], where: str) -> None:
    """Raise UserError where a record is not what was written.

    Older records have no checksum and are accepted.
    """
    stated = values["identity"].get(CHECKSUM)
    if stated not in (None, with_checksum(values)["identity"][CHECKSUM]):
        raise UserError(
            f"{where} is not what was written: a value in it was changed; restore it, or run "
            "the protocol again with --fresh."
        )


def _beside(folder: Path, suffix: str) -> Path:
    return folder.with_name(f".{folder.name}{suffix}")


def _repair(store: Path) -> None:
    """Put back runs whose replacement was interrupted; a store that is read-only stays as it is."""
    for before in store.glob(f".*{BEFORE}"):
        folder = store / before.name.removeprefix(".").removesuffix(BEFORE)
        with suppress(OSError), locked(_beside(folder, ".lock")):
            _put_back(before, folder)


def _put_back(before: Path, folder: Path) -> None:
    """Put the earlier run back where its replacement did not take place, else remove it."""
    if before.is_dir() and not folder.exists():
        before.rename(folder)
    shutil.rmtree(before, ignore_errors=True)
