"""Writing a data set so that what was acknowledged survives a crash.

A sample is acknowledged when ``add`` returns. Until then: image to a temporary name, fsync, rename,
fsync of the folder, line to the journal, fsync. Channels are added to their file instead.
``add_many`` acknowledges several samples together and waits for the disk as often as for one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import numpy as np

from tactibench.contacts import Signal
from tactibench.datasets.channels import CHANNEL_FILE, ChannelKind
from tactibench.datasets.checksums import write_checksums
from tactibench.datasets.images import (
    discard_images,
    rename_images,
    signal_bytes,
    write_images,
)
from tactibench.datasets.index import JournalIndex, write_index
from tactibench.datasets.journal import Event, Journal, read_content, read_lines, repair
from tactibench.datasets.rows import (
    JsonTypes,
    json_line,
    json_types,
    plan_hash,
    plan_lines,
    read_plan,
    write_row,
)
from tactibench.datasets.schema import (
    EVENTS,
    JOURNAL,
    LOCK,
    PLAN,
    REFERENCE,
    Draft,
    Header,
    Sample,
    image_name,
    is_dataset,
    resume_header,
    write_header,
)
from tactibench.datasets.splits import Split, write_split
from tactibench.datasets.storage import WriterLock, make_folder, sync_all, sync_folder
from tactibench.errors import UserError
from tactibench.records import atomic

PlanRow = Mapping[str, Any]
"""``id`` and anything else that the recorder needs to press the sample."""


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
        repaired: One sentence for each thing that an interrupted writer left and that was repaired.

    Raises:
        UserError: The folder holds files but no data set, a data set that is closed or has another
            plan or other settings, or another writer is at work.
    """

    def __init__(
        self, folder: Path, header: Header, plan: Iterable[PlanRow] = (), *, fsync: bool = True
    ) -> None:
        make_folder(folder)
        self.folder = folder
        self._lock = WriterLock(folder / LOCK)
        try:
            self._begin(header, list(plan))
            self._journal = Journal(folder / JOURNAL, fsync=fsync)
            self._event_journal = Journal(folder / EVENTS, fsync=fsync)
            self._channels = None
            if self.header.signal:
                self._channels = Journal(folder / CHANNEL_FILE, fsync=fsync)
            sync_folder(folder)
        except BaseException:
            self._lock.release()
            raise
        self._fsync = fsync
        self._extra_types: JsonTypes = {}
        for sample in self._samples.values():
            self._extra_types = json_types(self._extra_types, sample.extra, ("extra",))
        self._is_open = True

    def _begin(self, header: Header, rows: Sequence[PlanRow]) -> None:
        """Write header and plan of a new data set, or check and repair an existing one."""
        lines = plan_lines(rows)
        self._plan_ids = frozenset(row["id"] for row in rows)
        self.header = replace(header, plan_sha256=plan_hash(lines))
        self._samples: dict[int, Sample] = {}
        self._events: list[Event] = []
        self.repaired: tuple[str, ...] = ()
        if is_dataset(self.folder):
            self.header = resume_header(self.folder, self.header)
            read_plan(self.folder / PLAN, self.header.plan_sha256)
            content = read_content(self.folder)
            self._samples = {sample.id: sample for sample in content.samples}
            self._events = list(content.events)
            self.repaired = repair(self.folder, content)
            return
        others = [
            path.name
            for path in self.folder.iterdir()
            if not path.name.startswith(".") and path.name != PLAN
        ]
        if others:
            raise UserError(
                f"{self.folder} is not empty ({min(others)} is there) and holds no data set; name "
                "a new folder."
            )
        if lines:
            with atomic(self.folder / PLAN) as stream:
                stream.write(lines)
        write_header(self.folder, self.header)

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
            OSError: The disk refused.
        """
        self._check_open()
        self._check_ids(drafts)
        types = self._extra_types
        for draft in drafts:
            try:
                types = json_types(types, draft.extra, ("extra",))
            except UserError as error:
                raise UserError(f"sample {draft.id}: {error}") from None
        kind = self.header.kind
        stored = [signal_bytes(d.signal, kind, f"the frame of sample {d.id}") for d in drafts]
        names = [
            CHANNEL_FILE if isinstance(kind, ChannelKind) else image_name(draft.id)
            for draft in drafts
        ]
        samples = [
            draft.sample(name, hashlib.sha256(data).hexdigest())
            for draft, name, data in zip(drafts, names, stored, strict=True)
        ]
        lines = [write_row(sample, self.header.dome_radius_mm) for sample in samples]
        if self._channels is None:
            self._write_images(names, stored, self._journal, lines)
        else:
            self._write_channels(self._channels, stored, lines)
        self._extra_types = types
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
        if self._channels is not None:
            self.event("reference", channels=np.asarray(signal).tolist(), sha256=sha256)
            return
        name = f"{REFERENCE}/{f'{len(before):06d}' if before else 'rest'}.png"
        event = _event("reference", file_name=name, sha256=sha256)
        line = json_line(event, "event 'reference'")
        self._write_images([name], [data], self._event_journal, [line])
        self._events.append(event)

    def event(self, kind: str, **facts: Any) -> None:
        """Write an event, such as a stop, a recovery or a warning.

        Raises:
            UserError: A fact is no JSON value.
        """
        self._check_open()
        event = _event(kind, **facts)
        self._event_journal.append([json_line(event, f"event {kind!r}")])
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
        write_split(self.folder, name, Split.of(train, validation, test), self.samples)

    def close(self) -> None:
        """Close the data set, so that nothing more can be added.

        It stays open while ids of its plan are missing. A second call does nothing.
        """
        if not self._is_open:
            return
        if not self._fsync:
            sync_all()
            self._journal.sync()
            self._event_journal.sync()
            if self._channels is not None:
                self._channels.sync()
        if self._plan_ids <= self.done:
            samples = self.samples
            counts = {
                "samples": len(samples),
                "ok": sum(sample.status == "ok" for sample in samples),
                "presses": len({sample.press for sample in samples}),
            }
            journal = self._index()
            self.header = replace(
                self.header, status="closed", counts=counts, journal_sha256=journal.sha256
            )
            write_header(self.folder, self.header)
            write_checksums(self.folder)
            sync_folder(self.folder)
        self.leave_open()

    def _index(self) -> JournalIndex:
        """Return the index of the complete journal, and write it where it saves time."""
        lines = read_lines(self.folder / JOURNAL)
        ends = np.cumsum([len(line) + 1 for line in lines.whole], dtype=np.int64)
        ids = np.fromiter(self._samples, np.int64, len(self._samples))
        good = np.array([sample.status == "ok" for sample in self._samples.values()], bool)
        index = JournalIndex(self.folder / JOURNAL, ends, ids, good, lines.sha256, lines.torn)
        if len(ends) == len(ids):
            with suppress(OSError):  # it is made again when the data set is opened
                write_index(self.folder, index)
        return index

    def leave_open(self) -> None:
        """End writing for now; another writer may continue."""
        if self._is_open:
            self._is_open = False
            self._journal.close()
            self._event_journal.close()
            if self._channels is not None:
                self._channels.close()
            self._lock.release()

    def _write_images(
        self, names: Sequence[str], files: Sequence[bytes], journal: Journal, lines: Sequence[bytes]
    ) -> None:
        """Write images, then the lines that name them: a line never names a missing image."""
        try:
            write_images(self.folder, names, files, fsync=self._fsync)
        except BaseException:
            discard_images(self.folder, names)
            raise
        try:
            rename_images(self.folder, names, fsync=self._fsync)
            journal.append(lines)
        except BaseException:
            self.leave_open()  # what is half written is repaired when the folder is opened again
            raise

    def _write_channels(
        self, channels: Journal, rows: Sequence[bytes], lines: Sequence[bytes]
    ) -> None:
        """Write rows of channels, then the lines that acknowledge them."""
        try:
            channels.append(rows)
            self._journal.append(lines)
        except BaseException:
            self.leave_open()  # rows without a line are cut off when the folder is opened again
            raise

    def _check_open(self) -> None:
        if not self._is_open:
            raise UserError(f"the writer of {self.folder} is closed; open another one.")

    def _check_ids(self, drafts: Sequence[Draft]) -> None:
        new: set[int] = set()
        for draft in drafts:
            number: object = draft.id
            if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < 0:
                raise UserError(f"a sample's id is {number!r}; it must be a whole number from 0.")
            if number in self._samples or number in new:
                raise UserError(f"{self.folder} has a sample {number} already; an id stands once.")
            if self._plan_ids and number not in self._plan_ids:
                raise UserError(f"{self.folder} has no id {number} in its plan.")
            new.add(int(number))


def _event(kind: str, **facts: Any) -> dict[str, Any]:
    return {"kind": kind, "time": datetime.now(UTC).isoformat(timespec="milliseconds"), **facts}
