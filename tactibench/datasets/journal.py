"""The journals of a data set: writing, reading, and repair of what an interrupted writer leaves.

Lines are only ever added. Every line is one write, so that a crash tears the last line at most.
POSIX: a write to a file that was opened with O_APPEND goes to its end as one piece; fsync returns
when the disk has it. A repair touches nothing that was acknowledged: it removes temporary files
and moves all else to .trash/.
"""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.datasets.channels import CHANNEL_FILE, ChannelKind, unacknowledged_bytes
from tactibench.datasets.checksums import refuse_changed
from tactibench.datasets.index import JournalIndex, read_journal
from tactibench.datasets.rows import parse_object, read_optional, read_row
from tactibench.datasets.schema import (
    EVENTS,
    HEADER,
    IMAGES,
    JOURNAL,
    PLAN,
    SPLITS,
    TRASH,
    Header,
    Sample,
    image_number,
    is_image_name,
    is_reference_name,
    read_header,
)
from tactibench.datasets.storage import make_folder
from tactibench.errors import UserError
from tactibench.records import file_hash

Event = Mapping[str, Any]

UNFINISHED = ".part"
"""End of a temporary image's name; it starts with a dot, so that no reader of images takes it."""


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
    """The content of a data set's folder.

    Attributes:
        header: Facts that hold for every sample.
        samples: Samples in the order they were written.
        events: Events in the order they were noted.
        journal: Index of the journal of samples.
        event_lines: Lines of the journal of events.
    """

    header: Header
    samples: Sequence[Sample]
    events: tuple[Event, ...]
    journal: JournalIndex
    event_lines: Lines


def read_lines(path: Path) -> Lines:
    """Return the lines of a journal; a missing file has none.

    A last line without an end, or one that is no JSON, was never acknowledged.

    Raises:
        UserError: The file cannot be read.
    """
    data = read_optional(path)
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
    if header.status == "closed":
        refuse_changed(folder, HEADER, EVENTS)
    path = folder / JOURNAL
    changed = UserError(
        f"{path} is not what it was when the data set was closed; restore it "
        f"(`tactibench data verify {folder}` says what is wrong)."
    )
    try:
        journal, samples = read_journal(folder)
    except UserError:
        if (
            header.status == "closed"
            and path.is_file()
            and file_hash(path) != header.journal_sha256
        ):
            raise changed from None
        raise
    if header.status == "closed" and (journal.torn or journal.sha256 != header.journal_sha256):
        raise changed
    events = read_lines(folder / EVENTS)
    return Content(
        header,
        samples,
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
        self._file = path.open("ab", buffering=0)
        self._fsync = fsync

    def append(self, lines: Iterable[bytes]) -> None:
        """Add lines, each in one write, then wait for the disk once.

        Raises:
            OSError: The disk refused the lines; those that were written are removed again.
        """
        file = self._file.fileno()
        before = os.fstat(file).st_size
        try:
            for line in lines:
                if os.write(file, line) != len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), self._file.name)
            if self._fsync:
                os.fsync(file)
        except OSError:
            os.ftruncate(file, before)
            raise

    def sync(self) -> None:
        """Wait for the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._file.close()


def repair(folder: Path, content: Content) -> tuple[str, ...]:
    """Repair an open data set whose lock is held.

    Returns:
        One sentence for each thing that was done.
    """
    done = [
        _cut_torn_line(folder, JOURNAL, content.journal),
        _cut_torn_line(folder, EVENTS, content.event_lines),
    ]
    done.append(_cut_channels(folder, content))
    orphans = list(unnamed_images(folder, content))
    for name in orphans:
        target = _free_path(folder / TRASH / name)
        make_folder(target.parent)
        (folder / name).rename(target)
    if orphans:
        done.append(f"moved {_count(orphans, 'image')} that no line names to {TRASH}/")
    temporary = list(temporary_files(folder))
    for path in temporary:
        path.unlink()
    if temporary:
        done.append(f"removed {_count(temporary, 'unfinished file')}")
    return tuple(sentence for sentence in done if sentence)


def needs_repair(folder: Path, content: Content) -> bool:
    """Return whether an interrupted writer, or one at work, left anything to repair."""
    if content.journal.torn or content.event_lines.torn or any(temporary_files(folder)):
        return True
    if _channels_behind(folder, content):
        return True
    return next(unnamed_images(folder, content), None) is not None


def unnamed_images(folder: Path, content: Content) -> Iterator[str]:
    """Yield the names of the images on the disk that no line of the journal names."""
    ids: set[int] = set()
    if not isinstance(content.header.kind, ChannelKind):
        ids = set(content.journal.ids.tolist())
    for name in sample_images(folder):
        if image_number(name) not in ids:
            yield name


def sample_images(folder: Path) -> Iterator[str]:
    """Yield the names of all images of samples on the disk, whether a line names them or not."""
    for shard in _image_folders(folder):
        with os.scandir(shard) as entries:
            for entry in entries:
                name = f"{IMAGES}/{shard.name}/{entry.name}"
                if is_image_name(name):
                    yield name


def temporary_files(folder: Path) -> Iterator[Path]:
    """Yield the temporary files of writers that were interrupted before they renamed them."""
    for name in (HEADER, PLAN, f"{SPLITS}/"):  # names of ``tactibench.records.files.atomic``
        place, _, stem = name.rpartition("/")
        yield from (folder / place).glob(f".{stem}*.*")
    for shard in _image_folders(folder):
        yield from shard.glob(f".*{UNFINISHED}")


def _image_folders(folder: Path) -> list[Path]:
    images = folder / IMAGES
    return sorted(path for path in images.iterdir() if path.is_dir()) if images.is_dir() else []


def _cut_torn_line(folder: Path, name: str, lines: Lines | JournalIndex) -> str:
    if not lines.torn:
        return ""
    _cut_off(folder, name, lines.torn)
    return f"cut an unfinished line of {len(lines.torn):,} bytes off {name}"


def _channels_behind(folder: Path, content: Content) -> bytes:
    """Return the rows of channels that no line of the journal acknowledges."""
    kind = content.header.kind
    if not isinstance(kind, ChannelKind):
        return b""
    return unacknowledged_bytes(folder, kind, content.journal.count)


def _cut_channels(folder: Path, content: Content) -> str:
    behind = _channels_behind(folder, content)
    if not behind:
        return ""
    _cut_off(folder, CHANNEL_FILE, behind)
    return f"cut {len(behind):,} bytes that no line acknowledges off {CHANNEL_FILE}"


def _cut_off(folder: Path, name: str, end: bytes) -> None:
    """Move the end of a file to the trash."""
    copy = _free_path(folder / TRASH / f"{name}.torn")
    make_folder(copy.parent)
    copy.write_bytes(end)
    with (folder / name).open("r+b") as stream:
        stream.truncate((folder / name).stat().st_size - len(end))
        os.fsync(stream.fileno())


def _free_path(path: Path) -> Path:
    """Return the path, or the first of path.1, path.2 ... that is free."""
    free, number = path, 0
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name}.{number}")
    return free


def _count(things: Sized, noun: str) -> str:
    return f"{len(things):,} {noun}{'' if len(things) == 1 else 's'}"
