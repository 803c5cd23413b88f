"""The run store: one folder per run, complete or absent.

The answers of a run are stored before they are scored, under a hidden name beside its place. So
nothing that was computed is lost where the score fails.
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
"""Key of a record's identity: the digest of everything else in the record. It says that nothing
changed by accident; who changes a record on purpose writes another, and is found out by
``tactibench verify``."""
BEFORE = ".before"
"""Ends the name of a run that is being replaced, until the new one has its place."""
ANSWERS = ".answers"
"""Ends the hidden name of a run whose answers are stored and that is not scored yet."""
PARTS = ("truth", "predictions", "maps", "times", "examples")
"""Arrays beside a record: truth and predictions of every frame, heatmaps, raw call times, and a few
test frames for pictures."""

Arrays = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class StoredRun:
    """A run on disk."""

    folder: Path
    record: Record

    def arrays(self, part: str) -> Arrays:
        """One of PARTS, verified. Raises UserError when it is missing, damaged or changed."""
        path = self.folder / f"{part}.npz"
        arrays = read_arrays(path)
        if arrays_hash(arrays) != self.record.identity.stored.get(part):
            raise UserError(f"{path} is not what its record was made from; run the protocol again.")
        return arrays


def write_run(store: Path, record: Record, parts: Mapping[str, Arrays]) -> StoredRun:
    """Store a run whole: nothing is visible under its name before everything is written.

    A run that has the name already is replaced. Raises UserError when the record breaks an
    invariant.
    """
    answers = write_answers(store, record, parts)
    return complete_run(answers, answers.record)


def write_answers(store: Path, record: Record, parts: Mapping[str, Arrays]) -> StoredRun:
    """Store the arrays of a run with its record, hidden until ``complete_run`` shows the run.

    Args:
        store: Folder of the run store.
        record: Of the run; it may lack the metrics.
        parts: The arrays, by the names of PARTS.

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
    """Hold the name of a run: two processes that make one run write and score in turn."""
    return locked(_beside(store / name, ".lock"))


def unscored_run(store: Path, name: str) -> StoredRun | None:
    """Return the answers of the run of this name that wait for their score; None without any."""
    return _readable(_beside(store / name, ANSWERS))


def complete_run(answers: StoredRun, record: Record) -> StoredRun:
    """Give stored answers the record of their run, and the run its name.

    A run that has the name already is replaced.

    Raises:
        UserError: The record breaks an invariant; the answers stay where they are.
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
    """Open a run by its name in the store, its folder, or its record file. Raises UserError."""
    _repair(store)
    given = Path(name)
    folder = given.parent if given.name == RECORD else given
    if not (folder / RECORD).is_file():
        folder = store / name
    if not (folder / RECORD).is_file():
        known = [run.folder.name for run in stored_runs(store)]
        near = did_you_mean(name, known) if known else "it holds no run yet."
        raise UserError(f"there is no run {name!r} in {store}; {near}")
    return _opened(folder)


def readable_run(store: Path, name: str) -> StoredRun | None:
    """The run of this name; None where there is none, or none that can be read."""
    _repair(store)
    return _readable(store / name)


def run_names(store: Path) -> list[str]:
    """Names of the runs in a store, sorted, whether they can be read or not."""
    if not store.is_dir():
        return []
    _repair(store)
    names = sorted(path.name for path in store.iterdir())
    return [name for name in names if name[0] != "." and (store / name / RECORD).is_file()]


def stored_runs(store: Path) -> Iterator[StoredRun]:
    """Readable runs of a store, sorted by name; unreadable ones are left out."""
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
    """Raise UserError for a record that is not what was written. Older ones have no checksum."""
    stated = values["identity"].get(CHECKSUM)
    if stated not in (None, with_checksum(values)["identity"][CHECKSUM]):
        raise UserError(
            f"{where} is not what was written: a value in it was changed; restore it, or run "
            "the protocol again with --fresh."
        )


def _beside(folder: Path, suffix: str) -> Path:
    return folder.with_name(f".{folder.name}{suffix}")


def _repair(store: Path) -> None:
    """Put back the runs whose replacement was stopped; a store that cannot be written stays."""
    for before in store.glob(f".*{BEFORE}"):
        folder = store / before.name.removeprefix(".").removesuffix(BEFORE)
        with suppress(OSError), locked(_beside(folder, ".lock")):
            _put_back(before, folder)


def _put_back(before: Path, folder: Path) -> None:
    """The run as it was before a replacement that did not take its place, or nothing beside it."""
    if before.is_dir() and not folder.exists():
        before.rename(folder)
    shutil.rmtree(before, ignore_errors=True)
