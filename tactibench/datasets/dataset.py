"""A data set that is opened for reading, and the comparison of its files with what was written."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts, Signal
from tactibench.datasets.files import (
    Split,
    check_split,
    parse_object,
    read_optional,
    read_plan,
    read_row,
    read_split,
    split_files,
)
from tactibench.datasets.schema import (
    EVENTS,
    JOURNAL,
    PLAN,
    ChannelKind,
    Header,
    Sample,
    contacts_of,
    is_reference_name,
    read_header,
)
from tactibench.errors import UserError
from tactibench.png import decode_png, read_file

Event = Mapping[str, Any]
Image = npt.NDArray[np.uint8]


def read_lines(path: Path) -> list[bytes]:
    """Return the acknowledged lines of a journal without line breaks; a missing file has none.

    What stands behind the last line break, and a last line that is no JSON, was left by a write
    that was interrupted.

    Raises:
        UserError: The file cannot be read.
    """
    *lines, _ = read_optional(path).split(b"\n")
    if lines and parse_object(lines[-1]) is None:
        lines.pop()
    return lines


def lines_hash(lines: Sequence[bytes]) -> str:
    """Return the sha256 of the lines of a journal."""
    return hashlib.sha256(b"".join(line + b"\n" for line in lines)).hexdigest()


def read_events(folder: Path) -> tuple[Event, ...]:
    """Return the events of a data set in the order they were noted.

    Raises:
        UserError: A line is no JSON object.
    """
    events = []
    for number, line in enumerate(read_lines(folder / EVENTS), start=1):
        event = parse_object(line)
        if event is None:
            raise UserError(f"{folder / EVENTS} line {number} is no JSON object; restore it.")
        events.append(event)
    return tuple(events)


class Samples(Sequence[Sample]):
    """The samples of a journal, each read from its line when it is asked for.

    Args:
        path: Path of the journal, for errors.
        lines: Its acknowledged lines.
    """

    def __init__(self, path: Path, lines: Sequence[bytes]) -> None:
        self._path = path
        self._lines = lines

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self._lines)

    @overload
    def __getitem__(self, row: int) -> Sample: ...

    @overload
    def __getitem__(self, row: slice) -> tuple[Sample, ...]: ...

    def __getitem__(self, row: int | slice) -> Sample | tuple[Sample, ...]:
        """Return the sample of a row, or the samples of a slice.

        Raises:
            IndexError: There is no such row.
            UserError: A line is damaged.
        """
        if isinstance(row, slice):
            return tuple(self[number] for number in range(len(self))[row])
        number = range(len(self))[row]
        return read_row(self._lines[number], f"{self._path} line {number + 1}")


@dataclass(frozen=True, eq=False)
class Dataset:
    """A data set on the disk.

    Attributes:
        folder: The data set's folder.
        header: Facts that hold for every sample.
        samples: Samples in the order they were written, bad ones included.
        events: Events in the order they were noted.
        sha256: Identity of labels and signals: the hash of the journal, which holds every signal's.
    """

    folder: Path
    header: Header
    samples: Sequence[Sample] = field(repr=False)
    events: tuple[Event, ...] = field(repr=False)
    sha256: str

    @cached_property
    def rest(self) -> Signal | None:
        """Signal of the undeformed sensor, like that of a sample; None if it was not recorded."""
        for number, event in enumerate(self.events, start=1):
            if event.get("kind") == "reference":
                return self._reference(event, f"{self.folder / EVENTS} line {number}")
        return None

    def _reference(self, event: Event, where: str) -> Signal:
        name, sha256, kind = event.get("file_name"), str(event.get("sha256")), self.header.kind
        if not isinstance(kind, ChannelKind):
            if not isinstance(name, str) or not is_reference_name(name):
                raise UserError(f"{where} names no reference frame; restore the line.")
            return decode_png(name, self._read(self.folder / name, sha256, where), kind)
        try:
            row = np.array(event["channels"], "<f4").reshape(kind.shape)
        except (KeyError, TypeError, ValueError):
            row = np.empty(0, "<f4")
        if hashlib.sha256(row.tobytes()).hexdigest() != sha256:
            raise UserError(f"{where} does not hold the channels at rest; restore the line.")
        return row.astype(np.float32)

    @cached_property
    def splits(self) -> Mapping[str, Split]:
        """Name -> split.

        Raises:
            UserError: A split has a press in two subsets, names an id that is no sample, or is
                damaged.
        """
        splits = {name: read_split(path) for name, path in split_files(self.folder).items()}
        for name, path in split_files(self.folder).items():
            check_split(splits[name], self.samples, str(path))
        return splits

    def plan(self) -> tuple[Mapping[str, Any], ...]:
        """Return the rows of plan.jsonl.

        Raises:
            UserError: The plan was changed or is damaged.
        """
        return read_plan(self.folder / PLAN, self.header.plan_sha256)

    def contacts(self, sample: Sample) -> Contacts | None:
        """Return the contacts of a sample on the header's dome; None where one is unknown."""
        return contacts_of(sample.scene, self.header.dome_radius_mm, sample.contacts_force_n)

    def signal(self, sample: Sample) -> Signal:
        """Return the signal of a sample.

        Returns:
            An image, (H, W) or RGB (H, W, 3) uint8, or channels of the header's shape, float32.

        Raises:
            UserError: The file is not what was written; the sentence names file and sample.
        """
        data, kind = self.stored_bytes(sample), self.header.kind
        if isinstance(kind, ChannelKind):
            return np.frombuffer(data, "<f4").astype(np.float32).reshape(kind.shape)
        return decode_png(self.folder / sample.file_name, data, kind)

    def stored_bytes(self, sample: Sample) -> bytes:
        """Return the PNG file of a sample's image, or its row of channels, not decoded.

        Raises:
            UserError: The file is not what was written.
        """
        row = self._row_of[sample.id] if isinstance(self.header.kind, ChannelKind) else 0
        return self._read(self.folder / sample.file_name, sample.sha256, f"sample {sample.id}", row)

    def _read(self, path: Path, sha256: str, what: str, row: int = 0) -> bytes:
        """Return the bytes of a file, or of a row of channels, that have this hash."""
        kind = self.header.kind
        if isinstance(kind, ChannelKind):
            try:
                with path.open("rb") as file:
                    file.seek(row * kind.row_bytes)
                    data = file.read(kind.row_bytes)
            except OSError as error:
                raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None
        else:
            data = read_file(path)
        if hashlib.sha256(data).hexdigest() != sha256:
            place = f"{path} row {row + 1}" if isinstance(kind, ChannelKind) else path
            raise UserError(
                f"{place} was changed after it was written (checksum of {what}); restore it from a "
                "copy."
            )
        return data

    @cached_property
    def _row_of(self) -> dict[int, int]:
        return {sample.id: row for row, sample in enumerate(self.samples)}


def open_dataset(folder: Path) -> Dataset:
    """Open a data set for reading; nothing is changed.

    Raises:
        UserError: The folder holds no data set, or the journal of a closed one was changed.
    """
    header, lines = read_header(folder), read_lines(folder / JOURNAL)
    sha256 = lines_hash(lines)
    if header.status == "closed" and sha256 != header.journal_sha256:
        raise UserError(
            f"{folder / JOURNAL} is not what it was when the data set was closed; restore it "
            f"(`tactibench data verify {folder}` says what is wrong)."
        )
    samples = Samples(folder / JOURNAL, lines)
    return Dataset(folder, header, samples, read_events(folder), sha256)


def count_samples(folder: Path) -> int:
    """Return the number of lines in the journal, which may be damaged.

    Raises:
        UserError: The folder holds no data set.
    """
    read_header(folder)
    return len(read_lines(folder / JOURNAL))


def verify(folder: Path, advance: Callable[[int], None] = lambda _: None) -> list[str]:
    """Compare signals, journals, plan and splits of a data set with what was written.

    Args:
        folder: The data set's folder, in which nothing is changed.
        advance: Called with the number of samples that were finished.

    Returns:
        One sentence for each thing that is not as it was written; none for an intact data set.

    Raises:
        UserError: The folder holds no data set.
    """
    header, lines = read_header(folder), read_lines(folder / JOURNAL)
    journal, findings, samples = folder / JOURNAL, list[str](), list[Sample]()
    row_of: dict[int, int] = {}
    for row, line in enumerate(lines):
        try:
            sample = read_row(line, f"{journal} line {row + 1}")
        except UserError as error:
            findings.append(str(error))
            continue
        samples.append(sample)
        if (first := row_of.setdefault(sample.id, row)) != row:
            findings.append(
                f"{journal} lines {first + 1} and {row + 1} are both of id {sample.id}; an id "
                "stands once: remove one of them."
            )
    if header.status == "closed" and lines_hash(lines) != header.journal_sha256:
        findings.append(
            f"{journal} is not what it was when the data set was closed (checksum, "
            f"{header.counts.get('samples', 0):,} samples then, {len(samples):,} sound lines now); "
            "restore it from a copy."
        )
    try:
        events = read_events(folder)
    except UserError as error:
        findings.append(str(error))
        events = ()
    dataset = Dataset(folder, header, samples, events, "")
    # A row of channels belongs to its line, also where lines before it are damaged.
    dataset.__dict__["_row_of"] = row_of
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for sentences in pool.map(lambda sample: list(_finding(dataset.signal, sample)), samples):
            findings += sentences
            advance(1)
    for number, event in enumerate(events, start=1):
        if event.get("kind") == "reference":
            where = f"{folder / EVENTS} line {number}"
            findings += _finding(dataset._reference, event, where)
    findings += _finding(dataset.plan)
    for path in split_files(folder).values():
        findings += _finding(lambda path=path: check_split(read_split(path), samples, str(path)))
    return findings


def _finding(check: Callable[..., object], *arguments: object) -> Iterator[str]:
    """Yield the sentence with which a check refuses its arguments, if it does."""
    try:
        check(*arguments)
    except UserError as error:
        yield str(error)
