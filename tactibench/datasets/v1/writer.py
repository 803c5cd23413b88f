"""Writing a data set so that what was acknowledged survives a crash.

A sample is acknowledged when ``add`` returns. Until then: image to a temporary name, fsync, rename,
fsync of the folder, line to the journal, fsync. ``add_many`` acknowledges several samples together
and waits for the disk as often as for one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Scene
from tactibench.datasets.v1.begin import begin
from tactibench.datasets.v1.columns import Kind, joined, kind_of
from tactibench.datasets.v1.content import journal_hash
from tactibench.datasets.v1.durable import make_folder, sync_all, sync_file, sync_folder, write_new
from tactibench.datasets.v1.header import Header, closed, write_header
from tactibench.datasets.v1.images import png_of
from tactibench.datasets.v1.journal import Journal, read_lines
from tactibench.datasets.v1.layout import (
    EVENTS,
    JOURNAL,
    LOCK,
    REFERENCE,
    UNFINISHED,
    image_name,
)
from tactibench.datasets.v1.lock import Lock
from tactibench.datasets.v1.placing import ImagePlacer
from tactibench.datasets.v1.plan import PlanRow
from tactibench.datasets.v1.rows import json_line, row_text
from tactibench.datasets.v1.sample import Draft, Sample, Status
from tactibench.datasets.v1.splits import split_of, write_split
from tactibench.errors import UserError


class Writer:
    """Writes a new data set, or goes on with an open one.

    plan: what is to be recorded, each row with an ``id``. fsync: False waits for the disk once, in
    ``close``, and acknowledges nothing before it; for what can be made again.
    Raises UserError when the folder holds something else, another plan, other settings, or another
    writer is at work. Leaving the ``with`` block closes the data set, an exception leaves it open.
    """

    def __init__(
        self, folder: Path, header: Header, plan: Iterable[PlanRow] = (), *, fsync: bool = True
    ) -> None:
        make_folder(folder)
        self.folder = folder
        self._lock = Lock(folder / LOCK)
        try:
            self._begun = begin(folder, header, plan)
            self._journal = Journal(folder / JOURNAL, fsync=fsync)
            self._events = Journal(folder / EVENTS, fsync=fsync)
            sync_folder(folder)
        except BaseException:
            self._lock.release()
            raise
        self._fsync = fsync
        self._samples = {sample.id: sample for sample in self._begun.samples}
        self._extra: Kind = None
        for sample in self._begun.samples:
            self._extra = joined(self._extra, kind_of(sample.extra), "extra")
        self._images = ImagePlacer(folder, self._begun.header, fsync=fsync)
        self._at_work = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.close()
        else:
            self.leave_open()

    @property
    def header(self) -> Header:
        return self._begun.header

    @property
    def done(self) -> frozenset[int]:
        """Ids that are there."""
        return frozenset(self._samples)

    @property
    def samples(self) -> tuple[Sample, ...]:
        """What is there, in the order it was written."""
        return tuple(self._samples.values())

    @property
    def events(self) -> tuple[Mapping[str, Any], ...]:
        """What was noted, in the order it was written."""
        return self._begun.events

    @property
    def repaired(self) -> tuple[str, ...]:
        """What had to be mended of an interrupted writer, in sentences."""
        return self._begun.repaired

    def add(
        self,
        image: npt.NDArray[np.uint8] | bytes,
        *,
        id: int,  # noqa: A002 - the name of the key in the journal
        scene: Scene | None = None,
        labels: Mapping[str, float] | None = None,
        press: str = "",
        session: str = "",
        t_frame_ns: int | None = None,
        extra: Mapping[str, Any] | None = None,
        status: Status = "ok",
        attempt: int = 1,
    ) -> Sample:
        """Write one sample; when this returns it is on the disk. The arguments are those of Draft.

        Raises UserError, and writes nothing, for an id that is there and for a sample that is not
        like the others; OSError when the disk refuses.
        """
        draft = Draft(
            image, id, scene, labels or {}, press, session, t_frame_ns, extra or {}, status, attempt
        )
        return self.add_many([draft])[0]

    def add_many(self, drafts: Sequence[Draft]) -> tuple[Sample, ...]:
        """Write samples that are acknowledged together; as ``add`` of each, but several times
        faster on a slow disk."""
        self._check_at_work()
        self._check_ids(drafts)
        extra = self._extra
        for draft in drafts:
            extra = joined(extra, kind_of(draft.extra), f"sample {draft.id}: extra")
        try:
            hashes = self._images.write(drafts)
            samples = [_sample(draft, sha) for draft, sha in zip(drafts, hashes, strict=True)]
            lines = [row_text(sample, self.header.dome_radius_mm) for sample in samples]
        except BaseException:
            self._images.forget(drafts)
            raise
        try:
            self._images.rename(drafts)
            self._journal.append(lines)
        except BaseException:
            self.leave_open()  # what is half written is mended when the folder is opened again
            raise
        self._extra = extra
        self._samples.update((sample.id, sample) for sample in samples)
        return tuple(samples)

    def reference(self, image: npt.NDArray[np.uint8] | bytes) -> None:
        """Write a frame of the undeformed sensor. The first is the data set's rest frame; the same
        image again changes nothing, another one is kept beside it."""
        self._check_at_work()
        data = png_of(image, self.header, "the reference frame")
        sha256 = hashlib.sha256(data).hexdigest()
        known = [event for event in self._begun.events if event.get("kind") == "reference"]
        if known and known[-1].get("sha256") == sha256:
            return
        name = f"{REFERENCE}/{'rest' if not known else f'{len(known):06d}'}.png"
        path = self.folder / name
        make_folder(path.parent)
        part = path.with_name(f".{path.name}{UNFINISHED}")
        write_new(part, data)
        if self._fsync:
            sync_file(part)
        part.replace(path)
        if self._fsync:
            sync_folder(path.parent)
        self.event("reference", file_name=name, sha256=sha256)

    def event(self, kind: str, **facts: Any) -> None:
        """Note what happened: a stop, a recovery, a warning. Raises UserError for no JSON."""
        self._check_at_work()
        when = datetime.now(UTC).isoformat(timespec="milliseconds")
        event = {"kind": kind, "time": when, **facts}
        self._events.append([json_line(event, f"event {kind!r}")])
        self._begun = self._begun.with_event(event)

    def split(
        self,
        name: str,
        train: Sequence[int] = (),
        validation: Sequence[int] = (),
        test: Sequence[int] = (),
    ) -> None:
        """Write splits/<name>.json. Raises UserError when two parts share a press."""
        self._check_at_work()
        write_split(self.folder, name, split_of(train, validation, test), self.samples)

    def close(self) -> None:
        """Close the data set: nothing can be added any more. It stays open while ids of its plan
        are missing. Nothing happens the second time."""
        if not self._at_work:
            return
        if not self._fsync:
            sync_all()
            self._journal.sync()
            self._events.sync()
        if self._begun.plan_ids <= self.done:
            counts = _counts(self._samples.values())
            sha256 = journal_hash(read_lines(self.folder / JOURNAL))
            self._begun = self._begun.with_header(closed(self.header, counts, sha256))
            write_header(self.folder, self.header)
            sync_folder(self.folder)
        self.leave_open()

    def leave_open(self) -> None:
        """End writing for now; another writer may go on."""
        if self._at_work:
            self._at_work = False
            self._images.close()
            self._journal.close()
            self._events.close()
            self._lock.release()

    def _check_at_work(self) -> None:
        if not self._at_work:
            raise UserError(f"the writer of {self.folder} is closed; open another one.")

    def _check_ids(self, drafts: Sequence[Draft]) -> None:
        new: set[int] = set()
        plan = self._begun.plan_ids
        for draft in drafts:
            number: object = draft.id
            if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < 0:
                raise UserError(f"a sample's id is {number!r}; it must be a whole number from 0.")
            if number in self._samples or number in new:
                raise UserError(f"{self.folder} has a sample {number} already; an id stands once.")
            if plan and number not in plan:
                raise UserError(f"{self.folder} has no id {number} in its plan.")
            new.add(int(number))


def _sample(draft: Draft, sha256: str) -> Sample:
    return Sample(
        int(draft.id),
        image_name(draft.id),
        sha256,
        draft.status,
        draft.scene,
        {str(name): float(value) for name, value in draft.labels.items()},
        draft.press or str(draft.id),
        draft.session,
        draft.attempt,
        draft.t_frame_ns,
        dict(draft.extra),
    )


def _counts(samples: Iterable[Sample]) -> dict[str, int]:
    everything = list(samples)
    return {
        "samples": len(everything),
        "ok": sum(sample.status == "ok" for sample in everything),
        "presses": len({sample.press for sample in everything}),
    }
