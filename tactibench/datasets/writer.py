"""Writing a data set so that what was acknowledged survives a crash.

A sample is acknowledged when its line stands in the journal. Before that: image to a temporary
name, fsync, rename, fsync of the folder. Channels are added to their file instead. Lines are only
ever added, in one write, and fsync returns when the disk has them; so a crash tears the last line
at most. ``add_many`` acknowledges several samples together and waits as often as for one.
"""

from __future__ import annotations

import errno
import glob
import hashlib
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self
from uuid import uuid4

import numpy as np

from tactibench.contacts import Signal
from tactibench.datasets.schema import (
    CHANNEL_FILE,
    EVENTS,
    IMAGES,
    JOURNAL,
    LOCK,
    PLAN,
    REFERENCE,
    ChannelKind,
    Draft,
    Event,
    Header,
    Sample,
    Split,
    image_name,
    is_dataset,
    json_line,
    lines_hash,
    plan_hash,
    plan_lines,
    read_events,
    read_lines,
    read_plan,
    read_row,
    resume_header,
    write_header,
    write_row,
    write_split,
)
from tactibench.errors import UserError
from tactibench.png import ImageKind, check_png, decode_png, encode_png
from tactibench.records import atomic

PlanRow = Mapping[str, Any]
"""``id`` and anything else that the recorder needs to press the sample."""

_WRITTEN = re.compile(r"\d{6,}\.png|\..*\.part")
"""Names of images that a writer makes; other people's files stay."""
_SYNC_THREADS = 16
"""Threads that wait for the disk at once, so that it writes their files together."""
_PLAIN_PNG = (b"\x08\x00", b"\x08\x02")
"""Bits and colour type, at bytes 24 and 25 of a PNG: 8-bit gray and 8-bit RGB."""


def is_plain_png(data: bytes) -> bool:
    """Return whether a PNG can be copied into a data set: 8-bit gray or RGB, no alpha."""
    return data[:4] == b"\x89PNG" and data[24:26] in _PLAIN_PNG


def signal_bytes(signal: Signal | bytes, kind: ImageKind | ChannelKind, what: str) -> bytes:
    """Return what a data set stores of a sample: the PNG file of an image, or a row of channels.

    Args:
        signal: The image, the bytes of its PNG file, the channels, or the bytes of their row; bytes
            are stored as they are.
        kind: Kind of the data set's images or channels.
        what: Words for the sample, for errors.

    Raises:
        UserError: The signal differs in shape or type from those of the data set, is a PNG that a
            data set cannot hold, or is not finite.
    """
    if isinstance(signal, bytes):
        if isinstance(kind, ImageKind):
            if check_png(what, signal) != kind or not is_plain_png(signal):
                raise UserError(f"{what} is not an 8-bit {kind} PNG without alpha; decode it.")
            decode_png(what, signal, kind)
        return signal
    array = np.asarray(signal)
    image = isinstance(kind, ImageKind)
    if array.shape != kind.shape or array.dtype.kind not in ("u" if image else "fiu"):
        raise UserError(
            f"{what} has the shape {array.shape} and type {array.dtype}, but this data set holds "
            f"{kind}: {kind.shape} of {'uint8' if image else 'float32'}."
        )
    if image:
        return encode_png(array.astype(np.uint8))
    with np.errstate(over="ignore"):  # becomes infinite, which is refused
        row = array.astype("<f4")
    if not np.isfinite(row).all():
        raise UserError(f"{what} holds a channel that is no finite number; leave the sample out.")
    return row.tobytes()


class Journal:
    """A file to whose end acknowledged pieces are added.

    Args:
        path: The file.
        size: Bytes that were acknowledged; what stands behind them is cut off.
        fsync: Whether each ``append`` waits for the disk.
    """

    def __init__(self, path: Path, size: int, *, fsync: bool) -> None:
        self._file = path.open("ab", buffering=0)
        self._fsync = fsync
        self._file.truncate(size)

    def append(self, pieces: Sequence[bytes]) -> None:
        """Add pieces in one write, and wait for the disk.

        Raises:
            OSError: The disk refused them; what was written is removed again.
        """
        file, data = self._file.fileno(), b"".join(pieces)
        before = os.fstat(file).st_size
        try:
            if os.write(file, data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), self._file.name)
            if self._fsync:
                os.fsync(file)
        except OSError:
            os.ftruncate(file, before)
            raise

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._file.close()


class Writer:
    """Writes a new data set, or continues an open one.

    Leaving the ``with`` block closes the data set; an exception leaves it open.

    Args:
        folder: The data set's folder; it is made if it is missing.
        header: Facts that hold for every sample.
        plan: The presses to be recorded, each row with an ``id``. The data set stays open until it
            holds every id of the plan.
        fsync: False waits for the disk once, in ``close``, and acknowledges nothing before; for
            data that can be made again.

    Attributes:
        header: Facts that hold for every sample.

    Raises:
        UserError: The folder holds files but no data set, a data set that is closed or has another
            plan or other settings, or another writer is at work.
    """

    def __init__(
        self, folder: Path, header: Header, plan: Iterable[PlanRow] = (), *, fsync: bool = True
    ) -> None:
        from filelock import FileLock, Timeout  # takes a tenth of a second to import

        _make_folder(folder)
        self.folder = folder
        self._lock = FileLock(folder / LOCK)
        try:
            self._lock.acquire(timeout=0)
        except Timeout:
            raise UserError(
                f"{folder} is being written by another process; wait for it or end it."
            ) from None
        self._fsync, self._is_open = fsync, True
        self._journals: dict[str, Journal] = {}
        try:
            self._begin(header, list(plan))
            _sync_folder(folder)
        except BaseException:
            self.leave_open()
            raise

    def _begin(self, header: Header, rows: Sequence[PlanRow]) -> None:
        """Write header and plan of a new data set, or continue an existing one."""
        lines = plan_lines(rows)
        self._plan_ids = frozenset(row["id"] for row in rows)
        self.header = replace(header, plan_sha256=plan_hash(lines))
        if is_dataset(self.folder):
            self.header = resume_header(self.folder, self.header)
            read_plan(self.folder / PLAN, self.header.plan_sha256)
        else:
            others = [path.name for path in self.folder.iterdir() if not path.name.startswith(".")]
            if others and others != [PLAN]:
                raise UserError(
                    f"{self.folder} is not empty ({min(others)} is there); name a new folder."
                )
            if lines:
                with atomic(self.folder / PLAN) as stream:
                    stream.write(lines)
            write_header(self.folder, self.header)
        self._samples: dict[int, Sample] = {}
        written = read_lines(self.folder / JOURNAL)
        for number, line in enumerate(written, start=1):
            sample = read_row(line, f"{self.folder / JOURNAL} line {number}")
            if self._samples.setdefault(sample.id, sample) is not sample:
                raise UserError(
                    f"{self.folder / JOURNAL} line {number} is a second one of id {sample.id}; "
                    "remove one of them."
                )
        self._events = list(read_events(self.folder))
        self._continue(JOURNAL, sum(len(line) + 1 for line in written))
        self._continue(EVENTS, sum(len(line) + 1 for line in read_lines(self.folder / EVENTS)))
        if isinstance(self.header.kind, ChannelKind):
            self._continue(CHANNEL_FILE, len(written) * self.header.kind.row_bytes)
        self._remove_unacknowledged()

    def _continue(self, name: str, size: int) -> None:
        self._journals[name] = Journal(self.folder / name, size, fsync=self._fsync)

    def _remove_unacknowledged(self) -> None:
        """Remove the images of an interrupted writer that no line names."""
        named = {sample.file_name for sample in self._samples.values()}
        named |= {str(event.get("file_name")) for event in self._events}
        for path in (self.folder / IMAGES).glob("*/*"):
            name = path.relative_to(self.folder).as_posix()
            if _WRITTEN.fullmatch(path.name) and name not in named:
                path.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self.leave_open()

    @property
    def done(self) -> frozenset[int]:
        """Ids of the samples that were written."""
        return frozenset(self._samples)

    @property
    def samples(self) -> tuple[Sample, ...]:
        """Samples in the order they were written."""
        return tuple(self._samples.values())

    @property
    def events(self) -> tuple[Event, ...]:
        """Events in the order they were noted."""
        return tuple(self._events)

    def add(self, draft: Draft) -> Sample:
        """Write one sample; when this returns, the disk has it.

        Raises:
            UserError: The id exists already or is not in the plan, or the sample differs in kind
                from the others; nothing was written.
            OSError: The disk refused.
        """
        return self.add_many([draft])[0]

    def add_many(self, drafts: Sequence[Draft]) -> tuple[Sample, ...]:
        """Write samples that are acknowledged together.

        The result is that of ``add`` for each, several times faster on a slow disk.

        Raises:
            UserError: An id exists already or is not in the plan, or a sample differs in kind from
                the others; nothing was written.
            OSError: The disk refused; the data set is left open.
        """
        self._check_open()
        self._check_ids(drafts)
        kind = self.header.kind
        stored = [signal_bytes(d.signal, kind, f"the frame of sample {d.id}") for d in drafts]
        samples = [
            draft.sample(
                CHANNEL_FILE if isinstance(kind, ChannelKind) else image_name(draft.id),
                hashlib.sha256(data).hexdigest(),
            )
            for draft, data in zip(drafts, stored, strict=True)
        ]
        lines = [write_row(sample, self.header.dome_radius_mm) for sample in samples]
        self._write([sample.file_name for sample in samples], stored, JOURNAL, lines)
        self._samples.update((sample.id, sample) for sample in samples)
        return tuple(samples)

    def reference(self, signal: Signal | bytes) -> None:
        """Write a frame of the undeformed sensor.

        The first one is the data set's rest frame. The same signal again changes nothing; another
        one is written beside it.

        Raises:
            UserError: The signal differs in shape or type from the data set's samples.
            OSError: The disk refused.
        """
        self._check_open()
        data = signal_bytes(signal, self.header.kind, "the reference frame")
        sha256 = hashlib.sha256(data).hexdigest()
        before = [event for event in self._events if event.get("kind") == "reference"]
        if before and before[-1].get("sha256") == sha256:
            return
        if isinstance(self.header.kind, ChannelKind):
            self.event("reference", channels=np.asarray(signal).tolist(), sha256=sha256)
            return
        name = f"{REFERENCE}/{f'{len(before):06d}' if before else 'rest'}.png"
        event = _event("reference", file_name=name, sha256=sha256)
        self._write([name], [data], EVENTS, [json_line(event, "event 'reference'")])
        self._events.append(event)

    def event(self, kind: str, **facts: Any) -> None:
        """Write an event, such as a stop, a recovery or a warning.

        Raises:
            UserError: A fact is no JSON value.
        """
        self._check_open()
        event = _event(kind, **facts)
        self._journals[EVENTS].append([json_line(event, f"event {kind!r}")])
        self._events.append(event)

    def split(
        self,
        name: str,
        train: Sequence[int] = (),
        validation: Sequence[int] = (),
        test: Sequence[int] = (),
    ) -> None:
        """Write splits/NAME.json.

        Raises:
            UserError: An id is no sample or is named twice, a press is in two subsets, the name
                cannot be used, or another split has the name.
        """
        self._check_open()
        split = Split(*(tuple(sorted(map(int, ids))) for ids in (train, validation, test)))
        write_split(self.folder, name, split, self.samples)

    def close(self) -> None:
        """Close the data set, so that nothing more can be added.

        It stays open while ids of its plan are missing. A second call does nothing.
        """
        if not self._is_open:
            return
        if not self._fsync and hasattr(os, "sync"):
            os.sync()
        if self._plan_ids <= self.done:
            samples = self.samples
            counts = {
                "samples": len(samples),
                "ok": sum(sample.status == "ok" for sample in samples),
                "presses": len({sample.press for sample in samples}),
            }
            sha = lines_hash(read_lines(self.folder / JOURNAL))
            self.header = replace(self.header, status="closed", counts=counts, journal_sha256=sha)
            write_header(self.folder, self.header)
            _sync_folder(self.folder)
        self.leave_open()

    def leave_open(self) -> None:
        """End writing for now; another writer may continue."""
        self._is_open = False
        for journal in self._journals.values():
            journal.close()
        self._lock.release()

    def _write(
        self, names: Sequence[str], stored: Sequence[bytes], journal: str, lines: Sequence[bytes]
    ) -> None:
        """Write signals, then the lines that acknowledge them."""
        try:
            if CHANNEL_FILE in self._journals:
                self._journals[CHANNEL_FILE].append(stored)
            else:
                self._write_images([self.folder / name for name in names], stored)
            self._journals[journal].append(lines)
        except BaseException:
            self.leave_open()  # what no line names is removed when writing goes on
            raise

    def _write_images(self, paths: Sequence[Path], files: Sequence[bytes]) -> None:
        """Write images under temporary names, wait for the disk, and give them their names."""
        folders = {path.parent for path in paths}
        for place in folders:
            _make_folder(place)
        temporary = [path.with_name(f".{path.name}.part") for path in paths]
        for part, data in zip(temporary, files, strict=True):
            part.write_bytes(data)
        if self._fsync:
            with ThreadPoolExecutor(_SYNC_THREADS) as pool:
                list(pool.map(_sync_file, temporary))  # an error of a thread is raised here
        for part, path in zip(temporary, paths, strict=True):
            part.replace(path)
        if self._fsync:
            for place in folders:
                _sync_folder(place)

    def _check_open(self) -> None:
        if not self._is_open:
            raise UserError(f"the writer of {self.folder} is closed; open another one.")

    def _check_ids(self, drafts: Sequence[Draft]) -> None:
        new: set[int] = set()
        for draft in drafts:
            number = draft.id
            if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or number < 0:
                raise UserError(f"a sample's id is {number!r}; it must be a whole number from 0.")
            if number in self._samples or number in new:
                raise UserError(f"{self.folder} has a sample {number} already; an id stands once.")
            if self._plan_ids and number not in self._plan_ids:
                raise UserError(f"{self.folder} has no id {number} in its plan.")
            new.add(number)


def _event(kind: str, **facts: Any) -> dict[str, Any]:
    return {"kind": kind, "time": datetime.now(UTC).isoformat(timespec="milliseconds"), **facts}


def _sync_file(path: Path) -> None:
    with path.open("r+b") as file:
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Wait until the disk has the names in a folder, where the system can open folders."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # Windows: names are durable with the file
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _make_folder(folder: Path) -> None:
    """Make a folder and those above it, each name durable."""
    if not folder.is_dir():
        _make_folder(folder.parent)
        folder.mkdir(exist_ok=True)
        _sync_folder(folder.parent)


@contextmanager
def new_folder(target: Path, source: Path) -> Iterator[Path]:
    """Yield a temporary folder beside ``target``, which takes its name when the block succeeds.

    What a killed process left of an earlier one is removed: nobody holds the lock beside it.

    Args:
        target: The folder to make.
        source: Folder of the data set, into which nothing may be written.

    Raises:
        UserError: ``target`` is no empty folder, lies in ``source``, or has no parent.
    """
    target = target.absolute()
    if not target.parent.is_dir():
        raise UserError(f"the folder {target.parent} is not there; make it first.")
    if target.resolve().is_relative_to(source.resolve()):
        raise UserError(f"{target} lies in the data set {source}; give a folder outside of it.")
    taken = target.exists() and not (target.is_dir() and not any(target.iterdir()))
    if taken or target.is_symlink():
        raise UserError(f"{target} is there already; give a new folder, nothing is overwritten.")
    from filelock import FileLock, Timeout  # takes a tenth of a second to import

    temporary = target.with_name(f".{target.name}.{uuid4().hex[:8]}")
    for left in target.parent.glob(f".{glob.escape(target.name)}.{'[0-9a-f]' * 8}.lock"):
        with suppress(Timeout):
            with FileLock(left, timeout=0):
                shutil.rmtree(left.with_suffix(""), ignore_errors=True)
            left.unlink(missing_ok=True)
    lock = FileLock(f"{temporary}.lock")
    lock.acquire()
    temporary.mkdir()
    try:
        yield temporary
        if target.is_dir():  # empty; a folder takes the place of an empty one on POSIX only
            target.rmdir()
        temporary.rename(target)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    finally:
        lock.release()
        Path(lock.lock_file).unlink(missing_ok=True)
