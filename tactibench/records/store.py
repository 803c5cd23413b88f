"""The run store: one folder per run, complete or absent.

The answers of a run are stored before they are scored, in a hidden folder beside the run's own, and
its record is written last. So no computed answer is lost where scoring fails.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from tactibench.errors import UserError, did_you_mean
from tactibench.records.files import (
    arrays_hash,
    atomic,
    beside,
    locked,
    read_arrays,
    read_json,
    replace_folder,
    write_arrays,
)
from tactibench.records.identity import digest
from tactibench.records.record import TABLES, Record, check_invariants, parse_record

if TYPE_CHECKING:
    import pandas as pd

STORE = Path("runs")
"""The run store where none is named."""
RECORD = "record.json"
CHECKSUM = "sealed"
"""Key of a record's identity: the digest of everything else in the record. It shows changes made by
accident. Somebody who changes a record on purpose can write a new digest."""
ANSWERS = ".answers"
"""Suffix of the hidden folder of a run whose answers are stored and not scored yet."""
PARTS = ("truth", "predictions", "maps", "times", "examples")
"""Arrays beside a record: truth and predictions of every frame, heatmaps, raw call times, and a few
test frames for pictures."""

Arrays = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True, repr=False)
class StoredRun:
    """A run on disk.

    Attributes:
        folder: Folder of the run.
        record: Contents of its ``record.json``.
        parts: Arrays that are in memory already, by the names of PARTS.
    """

    folder: Path
    record: Record
    parts: Mapping[str, Arrays] = field(default_factory=dict, compare=False)

    def __repr__(self) -> str:
        return f"StoredRun({self.name})"

    @property
    def name(self) -> str:
        """The name of the run in its store."""
        return self.record.name

    @property
    def metrics(self) -> pd.DataFrame:
        """Every metric by group: value, 95 % interval, counts and unit."""
        import pandas as pd

        return pd.DataFrame([row.json_values() for row in self.record.metrics])

    @property
    def speed(self) -> pd.DataFrame:
        """Latency by scenario, threads, batch and phase, in ms a call."""
        import pandas as pd

        return pd.DataFrame([row.json_values() for row in self.record.speed])

    def value(self, metric: str, group: str = "all") -> float | None:
        """Return the value of a metric; None where it is n/a.

        Args:
            metric: Name of the metric, such as "mae_mm".
            group: Name of the group, such as "mean".

        Raises:
            UserError: The run has no such metric, or not of this group.
        """
        row = self.record.metric(metric, group)
        if row is None:
            groups = [m.group for m in self.record.metrics if m.metric == metric]
            if groups:
                raise UserError(
                    f"run {self.name} has no {metric} of {group!r}; it has those of "
                    f"{', '.join(groups)}."
                )
            hint = did_you_mean(metric, {m.metric for m in self.record.metrics})
            raise UserError(f"run {self.name} has no metric {metric!r}; {hint}")
        return row.value

    def arrays(self, part: str) -> Arrays:
        """Return the arrays of one of PARTS, verified against the record.

        Raises:
            UserError: The file is missing, damaged, or not what the record was made from.
        """
        if part in self.parts:
            return self.parts[part]
        path = self.folder / f"{part}.npz"
        arrays = read_arrays(path)
        if arrays_hash(arrays) != self.record.identity.stored.get(part):
            raise UserError(f"{path} is not what its record was made from; run the protocol again.")
        return arrays


def write_answers(store: Path, record: Record, parts: Mapping[str, Arrays]) -> StoredRun:
    """Store the arrays of a run with its record, hidden until ``complete_run`` shows the run.

    Args:
        store: Folder of the run store. The caller holds the name of the run.
        record: Record of the run; it may lack the metrics.
        parts: Arrays, by the names of PARTS.

    Raises:
        UserError: The record breaks an invariant; nothing is written.
    """
    stored = {name: arrays_hash(parts[name]) for name in PARTS}
    record = _with_identity(record, stored=stored)
    check_invariants(record, f"the record of {record.name}")
    answers = beside(store / record.name, ANSWERS)
    shutil.rmtree(answers, ignore_errors=True)
    answers.mkdir(parents=True)
    try:
        for name in PARTS:
            write_arrays(answers / f"{name}.npz", parts[name])
        # The last file: with it the answers are complete.
        record = write_record(answers / RECORD, record)
    except BaseException:
        shutil.rmtree(answers, ignore_errors=True)
        raise
    return StoredRun(answers, record, parts)


def held_name(store: Path, name: str) -> AbstractContextManager[None]:
    """Return a lock on the name of a run: two processes that make one run take turns."""
    return locked(beside(store / name, ".lock"))


def unscored_run(store: Path, name: str) -> StoredRun | None:
    """Return the stored answers of a run that is not scored yet; None without readable ones."""
    return _readable(beside(store / name, ANSWERS))


def complete_run(answers: StoredRun, record: Record) -> StoredRun:
    """Give stored answers the final record of their run, and show the run under its name.

    A run of the same name is replaced. The caller holds the name of the run.

    Raises:
        UserError: The record breaks an invariant, and the answers stay where they are.
    """
    check_invariants(record, f"the record of {record.name}")
    record = write_record(answers.folder / RECORD, record)
    folder = answers.folder.with_name(record.name)
    replace_folder(answers.folder, folder)
    return StoredRun(folder, record, answers.parts)


def open_run(store: Path, name: str) -> StoredRun:
    """Open a run by its name in the store, its folder, or its record file.

    Raises:
        UserError: There is no such run, its record cannot be read or is invalid, or it was changed.
    """
    given = Path(name)
    folder = given.parent if given.name == RECORD else given
    if not (folder / RECORD).is_file():
        folder = store / name
    if not (folder / RECORD).is_file():
        names = run_names(store)
        near = did_you_mean(name, names) if names else "it holds no run yet."
        raise UserError(f"there is no run {name!r} in {store}; {near}")
    return _opened(folder)


def readable_run(store: Path, name: str) -> StoredRun | None:
    """Return the run of this name; None where there is none or it cannot be read."""
    return _readable(store / name)


def run_names(store: Path) -> list[str]:
    """Return the names of all runs in a store, sorted, whether they can be read or not."""
    if not store.is_dir():
        return []
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


def write_record(path: Path, record: Record) -> Record:
    """Write a record with its checksum, and return it with the checksum."""
    checksum = with_checksum(record.json_values())["identity"][CHECKSUM]
    record = _with_identity(record, checksum=checksum)
    with atomic(path) as stream:
        stream.write(text_of(record).encode())
    return record


def text_of(record: Record) -> str:
    """Return JSON with a line for every key and every row of a table, to read in a diff."""
    values = record.json_values()
    lines = [f" {_compact(name)}: {_value_text(name, value)}" for name, value in values.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _value_text(name: str, value: Any) -> str:
    if name not in TABLES:
        return _compact(value)
    columns, *rows = map(_compact, (value["columns"], *value["data"]))
    return f'{{"columns":{columns},"data":[\n' + ",\n".join(rows) + "\n ]}"


def _compact(value: Any) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))


def _with_identity(record: Record, **changes: Any) -> Record:
    identity = record.identity.model_copy(update=changes)
    return record.model_copy(update={"identity": identity})


def with_checksum(values: dict[str, Any]) -> dict[str, Any]:
    """Return a record with the digest of everything else in it."""
    identity = {name: value for name, value in values["identity"].items() if name != CHECKSUM}
    checksum = digest({**values, "identity": identity})
    return {**values, "identity": {**identity, CHECKSUM: checksum}}


def refuse_changed(values: dict[str, Any], where: str) -> None:
    """Raise UserError where a record is not what was written."""
    stated = values["identity"].get(CHECKSUM)
    if stated not in (None, with_checksum(values)["identity"][CHECKSUM]):
        raise UserError(
            f"{where} is not what was written: a value in it was changed; restore it, or run "
            "the protocol again with --fresh."
        )
