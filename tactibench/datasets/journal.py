"""The journals of a data set: files to which lines are only ever added.

Every line is one write, so that a crash tears the last line at most. POSIX: a write to a file that
was opened with O_APPEND goes to its end as one piece; fsync returns when the disk has it.
"""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.datasets.rows import parse_object, read_row
from tactibench.datasets.schema import (
    EVENTS,
    JOURNAL,
    Header,
    Sample,
    is_reference_name,
    read_header,
)
from tactibench.errors import UserError

Event = Mapping[str, Any]


@dataclass(frozen=True)
class Lines:
    """The lines of a journal.

    Attributes:
        whole: The finished lines, without their line breaks.
        size: Bytes of the finished lines on the disk.
        torn: Bytes behind them: a line whose writing was interrupted.
    """

    whole: tuple[bytes, ...]
    size: int
    torn: bytes

    @property
    def sha256(self) -> str:
        """Hash of the finished lines."""
        return hashlib.sha256(b"".join(line + b"\n" for line in self.whole)).hexdigest()


@dataclass(frozen=True)
class Content:
    """Header, samples in the order they were written, events, and both journals as they stand."""

    header: Header
    samples: tuple[Sample, ...]
    events: tuple[Event, ...]
    journal: Lines
    event_lines: Lines


def read_lines(path: Path) -> Lines:
    """Return the lines of a journal; a missing file has none.

    A last line without an end, or one that is no JSON, was never acknowledged.

    Raises:
        UserError: The file cannot be read.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        data = b""
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None
    *lines, _ = data.split(b"\n")
    if lines and parse_object(lines[-1]) is None:
        lines.pop()
    size = sum(len(line) + 1 for line in lines)
    return Lines(tuple(lines), size, data[size:])


def read_content(folder: Path) -> Content:
    """Read header and journals; nothing is changed.

    Raises:
        UserError: A finished line is damaged, an id stands twice, or the journal of a closed data
            set was changed. The sentence names file and line.
    """
    header = read_header(folder)
    path = folder / JOURNAL
    journal = read_lines(path)
    if header.status == "closed" and (journal.torn or journal.sha256 != header.journal_sha256):
        raise UserError(
            f"{path} is not what it was when the data set was closed; restore it "
            f"(`tactibench data verify {folder}` says what is wrong)."
        )
    samples, errors = parse_samples(path, journal)
    if errors:
        raise errors[0]
    events = read_lines(folder / EVENTS)
    return Content(
        header,
        tuple(samples.values()),
        tuple(
            read_event(line, f"{folder / EVENTS} line {number}")
            for number, line in enumerate(events.whole, start=1)
        ),
        journal,
        events,
    )


def parse_samples(path: Path, journal: Lines) -> tuple[dict[int, Sample], list[UserError]]:
    """Return the samples by number of their line, and an error for every wrong line."""
    first_line: dict[int, int] = {}
    samples: dict[int, Sample] = {}
    errors: list[UserError] = []
    for number, line in enumerate(journal.whole, start=1):
        try:
            sample = read_row(line, f"{path} line {number}")
            first = first_line.setdefault(sample.id, number)
            if first != number:
                raise UserError(
                    f"{path} lines {first} and {number} are both of id {sample.id}; an id "
                    "stands once: remove one of them."
                )
        except UserError as error:
            errors.append(error)
        else:
            samples[number] = sample
    return samples, errors


def read_event(line: bytes, where: str) -> Event:
    """Return the event of a line.

    Raises:
        UserError: The line is no JSON object; the sentence begins with ``where``.
    """
    event = parse_object(line)
    if event is None:
        raise UserError(f"{where} is no JSON object; restore it.")
    return event


def reference_file(event: Event, where: str) -> tuple[str, str]:
    """Return file name and sha256 of a reference frame.

    Raises:
        UserError: The event names no reference frame; the sentence begins with ``where``.
    """
    name, sha256 = event.get("file_name"), event.get("sha256")
    if not isinstance(name, str) or not isinstance(sha256, str) or not is_reference_name(name):
        raise UserError(f"{where} names no reference frame; restore the line.")
    return name, sha256


class Journal:
    """The writing end of a journal.

    Args:
        path: The journal's file.
        fsync: Whether each ``append`` waits for the disk.
    """

    def __init__(self, path: Path, *, fsync: bool = True) -> None:
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_BINARY", 0)
        self._file: int | None = os.open(path, flags, 0o644)
        self._path = path
        self._fsync = fsync

    def append(self, lines: Iterable[bytes]) -> None:
        """Add lines, each in one write, then wait for the disk once.

        Raises:
            OSError: The disk refused; what was written of the lines is taken back.
        """
        assert self._file is not None, "the journal is closed"  # noqa: S101
        before = os.fstat(self._file).st_size
        try:
            for line in lines:
                if os.write(self._file, line) != len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))
            if self._fsync:
                os.fsync(self._file)
        except OSError:
            os.ftruncate(self._file, before)
            raise

    def sync(self) -> None:
        """Wait for the disk."""
        if self._file is not None:
            os.fsync(self._file)

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


def cut_journal(path: Path, size: int) -> None:
    """Shorten a journal to its finished lines, and wait for the disk.

    Args:
        path: The journal's file.
        size: Bytes that stay.
    """
    with path.open("r+b") as stream:
        stream.truncate(size)
        os.fsync(stream.fileno())
