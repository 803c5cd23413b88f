"""Checking every file of a data set against what was written."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from tactibench.datasets.v1.cache import is_intact
from tactibench.datasets.v1.content import event_of, journal_hash
from tactibench.datasets.v1.dataset import reference_of
from tactibench.datasets.v1.header import Header, read_header
from tactibench.datasets.v1.images import read_image
from tactibench.datasets.v1.journal import Lines, read_lines
from tactibench.datasets.v1.layout import CACHE, EVENTS, JOURNAL, PLAN, REFERENCE, is_reference
from tactibench.datasets.v1.plan import read_plan
from tactibench.datasets.v1.repair import sample_images, unfinished
from tactibench.datasets.v1.rows import check_contacts, read_row
from tactibench.datasets.v1.sample import Sample
from tactibench.datasets.v1.splits import check_split, read_split, split_files
from tactibench.errors import UserError

_THREADS = os.cpu_count() or 1
_AHEAD = 16 * _THREADS


def count_samples(folder: Path) -> int:
    """Lines of the journal, which may be damaged. Raises UserError when there is no data set."""
    read_header(folder)
    return len(read_lines(folder / JOURNAL).whole)


def verify(folder: Path, advance: Callable[[int], None] = lambda _: None) -> list[str]:
    """Sentences on everything that is not as it was written; empty when all is intact.

    Every image is read, hashed and decoded; nothing is changed. ``advance`` is told of finished
    samples. Raises UserError when the folder is no data set.
    """
    header = read_header(folder)
    journal, events = read_lines(folder / JOURNAL), read_lines(folder / EVENTS)
    samples, findings = _samples(folder, header, journal)
    findings += _references(folder, header, events)
    findings += _images(folder, header, samples, advance)
    findings += _arrays(folder)
    findings += _lost(folder, [sample for _, sample in samples])
    findings += _plan(folder, header)
    findings += _splits(folder, [sample for _, sample in samples])
    findings += _closed(folder, header, journal, [sample for _, sample in samples])
    return findings


Numbered = tuple[int, Sample]
"""Line of the journal and its sample."""


def _samples(folder: Path, header: Header, journal: Lines) -> tuple[list[Numbered], list[str]]:
    samples: list[Numbered] = []
    findings = []
    first: dict[int, int] = {}
    for number, line in enumerate(journal.whole, start=1):
        where = f"{folder / JOURNAL} line {number}"
        try:
            sample = read_row(line, where)
        except UserError as error:
            findings.append(str(error))
            continue
        if first.setdefault(sample.id, number) != number:
            findings.append(
                f"{folder / JOURNAL} lines {first[sample.id]} and {number} are both of id "
                f"{sample.id}; remove one of them."
            )
            continue
        samples.append((number, sample))
        try:
            check_contacts(line, where, header.dome_radius_mm)
        except UserError as error:
            findings.append(str(error))
    if journal.torn and header.status == "open":
        findings.append(
            f"{folder / JOURNAL} ends in an unfinished line of {len(journal.torn)} bytes; opening "
            "the data set cuts it off."
        )
    return samples, findings


def _references(folder: Path, header: Header, events: Lines) -> Iterator[str]:
    named = set()
    for number, line in enumerate(events.whole, start=1):
        where = f"{folder / EVENTS} line {number}"
        try:
            event = event_of(line, where)
            if event.get("kind") == "reference":
                name, sha256 = reference_of(event, where)
                named.add(name)
                read_image(folder, name, sha256, header, where)
        except UserError as error:
            yield str(error)
    if events.torn:
        yield f"{folder / EVENTS} ends in an unfinished line; opening the data set cuts it off."
    for path in sorted((folder / REFERENCE).glob("*.png")):
        name = f"{REFERENCE}/{path.name}"
        if is_reference(name) and name not in named:
            yield f"{path} is named by no line of {EVENTS}; remove it."


def _images(
    folder: Path, header: Header, samples: Sequence[Numbered], advance: Callable[[int], None]
) -> Iterator[str]:
    """Findings on images, in the order of the journal."""

    def check(number: int, sample: Sample) -> str:
        try:
            where = f"{JOURNAL} line {number}"
            read_image(folder, sample.file_name, sample.sha256, header, where)
        except UserError as error:
            return str(error)
        return ""

    waiting: deque[Future[str]] = deque()
    with ThreadPoolExecutor(_THREADS) as pool:
        for number, sample in samples:
            waiting.append(pool.submit(check, number, sample))
            while len(waiting) >= _AHEAD:
                yield from filter(None, [waiting.popleft().result()])
                advance(1)
        while waiting:
            yield from filter(None, [waiting.popleft().result()])
            advance(1)


def _arrays(folder: Path) -> Iterator[str]:
    for path in sorted((folder / CACHE).glob("*.npy")):
        if not is_intact(path):
            yield f"{path} is damaged; delete it, it is made again from the images."


def _lost(folder: Path, samples: Sequence[Sample]) -> Iterator[str]:
    named = {sample.file_name for sample in samples}
    for name in sorted(set(sample_images(folder)) - named):
        yield f"{folder / name} is named by no line of {JOURNAL}; opening the data set moves it."
    for path in sorted(unfinished(folder)):
        yield f"{path} is the rest of an interrupted writer; opening the data set removes it."


def _plan(folder: Path, header: Header) -> Iterator[str]:
    try:
        read_plan(folder / PLAN, header.plan_sha256)
    except UserError as error:
        yield str(error)


def _splits(folder: Path, samples: Sequence[Sample]) -> Iterator[str]:
    for path in split_files(folder).values():
        try:
            check_split(read_split(path), samples, str(path))
        except UserError as error:
            yield str(error)


def _closed(
    folder: Path, header: Header, journal: Lines, samples: Sequence[Sample]
) -> Iterator[str]:
    if header.status != "closed":
        return
    if journal.torn or journal_hash(journal) != header.journal_sha256:
        yield (
            f"{folder / JOURNAL} is not what it was when the data set was closed (checksum); "
            "restore it from a copy."
        )
    count = header.counts.get("samples")
    if count != len(samples):
        yield (
            f"{folder / JOURNAL} has {len(samples):,} sound lines, but the data set was closed "
            f"with {count} samples; restore it from a copy."
        )
