"""The index beside a journal: where its lines end, their ids, and which samples are good.

With the index a data set is opened without reading every line as JSON. It is derived: a hash says
to which beginning of the journal it belongs, and all lines behind that are read one by one. An
index that is missing, damaged or of another journal is made again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import IO, Any, overload

import numpy as np
import numpy.typing as npt

from tactibench.datasets.rows import parse_object, read_row
from tactibench.datasets.schema import CACHE, JOURNAL, Sample
from tactibench.errors import UserError
from tactibench.records import read_checked_arrays, write_checked_arrays

INDEX = f"{CACHE}/index.npz"
SHORTEST = 10_000
"""Fewest lines for which an index is written; fewer are read in a third of a second."""
CHUNK = 2**20
"""Bytes that are hashed at once."""

Rows = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class JournalIndex:
    """The finished lines of a journal.

    Attributes:
        path: Path of the journal.
        ends: (N,) bytes from the beginning of the file to the end of each line.
        ids: (N,) ids of the samples.
        good: (N,) whether the status of a sample is "ok".
        sha256: Hash of all finished lines.
        torn: Bytes behind the finished lines, of a line whose writing was interrupted.
    """

    path: Path
    ends: Rows
    ids: Rows
    good: npt.NDArray[np.bool_]
    sha256: str
    torn: bytes = b""

    @property
    def count(self) -> int:
        """Number of lines."""
        return len(self.ends)

    @cached_property
    def _order(self) -> Rows:
        return np.argsort(self.ids, kind="stable")

    def row_of(self, number: int) -> int:
        """Return the row of an id.

        Raises:
            KeyError: No sample has the id.
        """
        order = self._order
        at = int(np.searchsorted(self.ids, number, sorter=order))
        if at == len(order) or self.ids[order[at]] != number:
            raise KeyError(number)
        return int(order[at])

    def __contains__(self, number: object) -> bool:
        """Return whether a sample has this id."""
        try:
            return isinstance(number, int) and self.row_of(number) >= 0
        except KeyError:
            return False


class Samples(Sequence[Sample]):
    """The samples of a journal, each read from its line when it is asked for."""

    def __init__(self, index: JournalIndex) -> None:
        self.journal = index

    def __len__(self) -> int:
        """Return the number of samples."""
        return self.journal.count

    @overload
    def __getitem__(self, row: int) -> Sample: ...

    @overload
    def __getitem__(self, row: slice) -> tuple[Sample, ...]: ...

    def __getitem__(self, row: int | slice) -> Sample | tuple[Sample, ...]:
        """Return the sample of a row, or the samples of a slice.

        Raises:
            IndexError: There is no such row.
            UserError: A line was changed since the journal was opened.
        """
        if isinstance(row, slice):
            return tuple(self._read(range(len(self))[row]))
        return next(self._read([range(len(self))[row]]))

    def __iter__(self) -> Iterator[Sample]:
        """Yield all samples."""
        return self._read(range(len(self)))

    def __eq__(self, other: object) -> bool:
        """Return whether another sequence holds the same samples."""
        if not isinstance(other, Sequence) or len(self) != len(other):
            return False
        return all(mine == theirs for mine, theirs in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]

    def _read(self, rows: Sequence[int]) -> Iterator[Sample]:
        index = self.journal
        with index.path.open("rb") as stream:
            for row in rows:
                start = int(index.ends[row - 1]) if row else 0
                stream.seek(start)
                where = f"{index.path} line {row + 1}"
                sample = read_row(stream.read(int(index.ends[row]) - start - 1), where)
                if sample.id != index.ids[row]:
                    raise UserError(f"{where} was changed while it was in use; open it again.")
                yield sample


@dataclass
class _Scan:
    """The part of a journal that was read so far.

    Attributes:
        path: Path of the journal.
        hasher: Hash of the lines that were read.
        ends: Bytes to the end of each new line.
        ids: Ids in the new lines.
        good: Whether the status in each new line is "ok".
        samples: Samples of the new lines, as long as the journal is short.
        known: Number of lines that the stored index holds.
        size: Bytes to the end of the last line that was read.
    """

    path: Path
    hasher: Any
    ends: list[int] = field(default_factory=list)
    ids: list[int] = field(default_factory=list)
    good: list[bool] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    known: int = 0
    size: int = 0

    def add(self, line: bytes) -> None:
        """Add a finished line, its line break included.

        Raises:
            UserError: The line is damaged.
        """
        sample = read_row(line[:-1], f"{self.path} line {self.known + len(self.ids) + 1}")
        self.hasher.update(line)
        self.size += len(line)
        self.ends.append(self.size)
        self.ids.append(sample.id)
        self.good.append(sample.status == "ok")
        if self.known + len(self.ids) < SHORTEST:
            self.samples.append(sample)


def read_journal(folder: Path) -> tuple[JournalIndex, Sequence[Sample]]:
    """Return the index of a data set's journal and its samples; a missing journal has no lines.

    The samples of a short journal are read at once, those of a long one when they are asked for.

    Raises:
        UserError: A finished line is damaged, an id stands twice, or the file cannot be read.
    """
    path = folder / JOURNAL
    try:
        stream = path.open("rb")
    except FileNotFoundError:
        return _index(path, [np.empty((0, 3), np.int64)], hashlib.sha256()), ()
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None
    with stream:
        stored, hasher = _stored(folder / INDEX, stream)
        scan = _Scan(path, hasher, known=len(stored), size=int(stored[-1, 0]) if len(stored) else 0)
        stream.seek(scan.size)
        torn = _read_rest(stream, scan)
    new = np.array([scan.ends, scan.ids, scan.good], np.int64).reshape(3, -1).T
    index = _index(path, [stored, new], hasher, torn)
    if len(new) >= SHORTEST:
        with suppress(OSError):  # of a folder that cannot be written, or a full disk
            write_index(folder, index)
    short = len(scan.samples) == index.count
    return index, tuple(scan.samples) if short else Samples(index)


def write_index(folder: Path, index: JournalIndex) -> None:
    """Write the index of a journal that has so many lines that the index saves time."""
    if index.count >= SHORTEST:
        rows = np.column_stack([index.ends, index.ids, index.good]).astype(np.int64)
        arrays = {"rows": rows, "sha256": np.array(index.sha256)}
        write_checked_arrays(folder / INDEX, arrays, compress=False)


def _stored(path: Path, journal: IO[bytes]) -> tuple[Rows, Any]:
    """Return the rows of a stored index and the hash of their lines.

    There are no rows where the index is missing or damaged, or does not belong to the journal.
    """
    arrays = read_checked_arrays(path) or {}
    rows, sha256 = arrays.get("rows"), arrays.get("sha256")
    if rows is None or sha256 is None or rows.ndim != 2 or rows.shape[1] != 3 or not len(rows):
        return np.empty((0, 3), np.int64), hashlib.sha256()
    hasher, left = hashlib.sha256(), int(rows[-1, 0])
    while left > 0 and (data := journal.read(min(CHUNK, left))):
        hasher.update(data)
        left -= len(data)
    if left or hasher.hexdigest() != str(sha256):
        return np.empty((0, 3), np.int64), hashlib.sha256()
    return rows.astype(np.int64), hasher


def _read_rest(stream: IO[bytes], scan: _Scan) -> bytes:
    """Read the lines from the position of the stream, and return the bytes of an unfinished one.

    A last line without an end, or one that is no JSON, was never acknowledged.
    """
    finished, unfinished = b"", b""
    for line in stream:
        if not line.endswith(b"\n"):
            unfinished = line
            break
        if finished:
            scan.add(finished)
        finished = line
    if finished and parse_object(finished[:-1]) is not None:
        scan.add(finished)
        finished = b""
    return finished + unfinished


def _index(path: Path, parts: list[Rows], hasher: Any, torn: bytes = b"") -> JournalIndex:
    ends, ids, good = np.concatenate(parts).T
    _refuse_twins(path, ids)
    return JournalIndex(path, ends, ids, good.astype(bool), hasher.hexdigest(), torn)


def _refuse_twins(path: Path, ids: Rows) -> None:
    order = np.argsort(ids, kind="stable")
    twins = np.flatnonzero(np.diff(ids[order]) == 0)
    if len(twins):
        second = min(order[twin + 1] for twin in twins)
        first = int(np.flatnonzero(ids == ids[second])[0])
        raise UserError(
            f"{path} lines {first + 1} and {second + 1} are both of id {ids[second]}; an id "
            "stands once: remove one of them."
        )
