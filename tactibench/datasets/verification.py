"""Comparison of every file of a data set with what was written."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from tactibench.datasets.channels import (
    CHANNEL_FILE,
    ChannelKind,
    read_channels,
    reference_channels,
    unacknowledged_bytes,
)
from tactibench.datasets.checksums import changed_files
from tactibench.datasets.images import is_intact, read_image
from tactibench.datasets.journal import (
    Lines,
    parse_samples,
    read_event,
    read_lines,
    reference_file,
    sample_images,
    temporary_files,
)
from tactibench.datasets.rows import check_contacts, read_plan
from tactibench.datasets.schema import (
    CACHE,
    EVENTS,
    JOURNAL,
    PLAN,
    REFERENCE,
    Header,
    Sample,
    is_reference_name,
    read_header,
)
from tactibench.datasets.splits import check_split, read_split, split_files
from tactibench.errors import UserError

_THREADS = os.cpu_count() or 1
_PREFETCH = 16 * _THREADS
"""Images that are read ahead: enough to keep all threads busy, few enough for any memory."""


def count_samples(folder: Path) -> int:
    """Return the number of lines in the journal, which may be damaged.

    Raises:
        UserError: The folder holds no data set.
    """
    read_header(folder)
    return len(read_lines(folder / JOURNAL).whole)


def verify(folder: Path, advance: Callable[[int], None] = lambda _: None) -> list[str]:
    """Check every image or row of channels, the journals, the plan, splits and derived arrays.

    Args:
        folder: The data set's folder, in which nothing is changed.
        advance: Called with the number of samples that were finished.

    Returns:
        One sentence for each thing that is not as it was written; none for an intact data set.

    Raises:
        UserError: The folder holds no data set.
    """
    header = read_header(folder)
    journal, events = read_lines(folder / JOURNAL), read_lines(folder / EVENTS)
    numbered, errors = parse_samples(folder / JOURNAL, journal)
    samples = list(numbered.values())
    findings = [str(error) for error in errors]
    findings += _check_contacts(folder / JOURNAL, header, journal, numbered)
    findings += _check_references(folder, header, events)
    findings += _check_signals(folder, header, journal, numbered, advance)
    findings += _check_arrays(folder)
    findings += _check_leftovers(folder, samples)
    findings += _finding(read_plan, folder / PLAN, header.plan_sha256)
    for path in split_files(folder).values():
        findings += _finding(lambda path=path: check_split(read_split(path), samples, str(path)))
    findings += _check_closed(folder, header, journal, samples)
    findings += _finding(lambda: findings.extend(changed_files(folder)))
    return findings


def _finding(check: Callable[..., object], *arguments: object) -> Iterator[str]:
    """Yield the sentence with which a check refuses its arguments, if it does."""
    try:
        check(*arguments)
    except UserError as error:
        yield str(error)


def _check_contacts(
    path: Path, header: Header, journal: Lines, samples: Iterable[int]
) -> Iterator[str]:
    """Yield findings on the contacts in lines of the journal.

    Args:
        path: Path of the journal.
        header: The data set's header.
        journal: Lines of the journal.
        samples: Numbers of the lines that hold a sample, from 1.
    """
    for number in samples:
        where = f"{path} line {number}"
        yield from _finding(check_contacts, journal.whole[number - 1], where, header.dome_radius_mm)
    if journal.torn and header.status == "open":
        yield (
            f"{path} ends in an unfinished line of {len(journal.torn)} bytes; opening the data set "
            "cuts it off."
        )


def _check_references(folder: Path, header: Header, events: Lines) -> Iterator[str]:
    named, kind = set(), header.kind
    for number, line in enumerate(events.whole, start=1):
        where = f"{folder / EVENTS} line {number}"
        try:
            event = read_event(line, where)
            if event.get("kind") != "reference":
                continue
            if isinstance(kind, ChannelKind):
                reference_channels(event, kind, where)
            else:
                name, sha256 = reference_file(event, where)
                named.add(name)
                read_image(folder, name, sha256, kind, where)
        except UserError as error:
            yield str(error)
    if events.torn:
        yield f"{folder / EVENTS} ends in an unfinished line; opening the data set cuts it off."
    for path in sorted((folder / REFERENCE).glob("*.png")):
        name = f"{REFERENCE}/{path.name}"
        if is_reference_name(name) and name not in named:
            yield f"{path} is named by no line of {EVENTS}; remove it."


def _check_signals(
    folder: Path,
    header: Header,
    journal: Lines,
    samples: Mapping[int, Sample],
    advance: Callable[[int], None],
) -> Iterator[str]:
    """Yield findings on images or channels, in the order of the journal."""
    kind = header.kind

    def check(number: int, sample: Sample) -> list[str]:
        where = f"{JOURNAL} line {number}"
        if isinstance(kind, ChannelKind):
            row = (folder, number - 1, sample.sha256, kind, where)
            return list(_finding(read_channels, *row))
        image = (folder, sample.file_name, sample.sha256, kind, where)
        return list(_finding(read_image, *image))

    waiting: deque[Future[list[str]]] = deque()
    with ThreadPoolExecutor(_THREADS) as pool:
        for number, sample in samples.items():
            waiting.append(pool.submit(check, number, sample))
            if len(waiting) == _PREFETCH:
                yield from waiting.popleft().result()
                advance(1)
        for future in waiting:
            yield from future.result()
            advance(1)
    if isinstance(kind, ChannelKind) and unacknowledged_bytes(folder, kind, len(journal.whole)):
        yield (
            f"{folder / CHANNEL_FILE} is longer than the lines of {JOURNAL}; opening the data set "
            "cuts it off."
        )


def _check_arrays(folder: Path) -> Iterator[str]:
    for path in sorted((folder / CACHE).glob("*.npy")):
        if not is_intact(path):
            yield f"{path} is damaged; delete it, it is made again from the images."


def _check_leftovers(folder: Path, samples: Sequence[Sample]) -> Iterator[str]:
    named = {sample.file_name for sample in samples}
    for name in sorted(set(sample_images(folder)) - named):
        yield f"{folder / name} is named by no line of {JOURNAL}; opening the data set moves it."
    for path in sorted(temporary_files(folder)):
        yield f"{path} is the rest of an interrupted writer; opening the data set removes it."


def _check_closed(
    folder: Path, header: Header, journal: Lines, samples: Sequence[Sample]
) -> Iterator[str]:
    if header.status != "closed":
        return
    if not (folder / JOURNAL).exists():
        yield f"{folder / JOURNAL} is missing; restore it from a copy."
        return
    if journal.torn or journal.sha256 != header.journal_sha256:
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
