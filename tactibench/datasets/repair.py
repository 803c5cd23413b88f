"""Repair of what an interrupted writer leaves: torn lines, nameless images, temporary files.

Nothing that was acknowledged is touched. Temporary files are removed, all else goes to .trash/.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from tactibench.datasets.image_files import UNFINISHED
from tactibench.datasets.journal import Content, Lines, cut_journal
from tactibench.datasets.schema import (
    EVENTS,
    HEADER,
    IMAGES,
    JOURNAL,
    PLAN,
    SPLITS,
    TRASH,
    is_image_name,
)
from tactibench.datasets.storage import make_folder


def repair(folder: Path, content: Content) -> tuple[str, ...]:
    """Repair an open data set whose lock is held.

    Returns:
        One sentence for each thing that was done.
    """
    done = [
        _cut_torn_line(folder, JOURNAL, content.journal),
        _cut_torn_line(folder, EVENTS, content.event_lines),
    ]
    named = {sample.file_name for sample in content.samples}
    orphans = [name for name in sample_images(folder) if name not in named]
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
    """Return whether an interrupted writer, or one at work, left anything."""
    if content.journal.torn or content.event_lines.torn or any(temporary_files(folder)):
        return True
    return not {sample.file_name for sample in content.samples}.issuperset(sample_images(folder))


def sample_images(folder: Path) -> Iterator[str]:
    """Give the names of all images of samples on the disk, whether a line names them or not."""
    for shard in _image_folders(folder):
        with os.scandir(shard) as entries:
            for entry in entries:
                name = f"{IMAGES}/{shard.name}/{entry.name}"
                if is_image_name(name):
                    yield name


def temporary_files(folder: Path) -> Iterator[Path]:
    """Give the temporary files of writers that did not come to rename them."""
    for name in (HEADER, PLAN, f"{SPLITS}/"):  # names of ``tactibench.records.files.atomic``
        place, _, stem = name.rpartition("/")
        yield from (folder / place).glob(f".{stem}*.*")
    for shard in _image_folders(folder):
        yield from shard.glob(f".*{UNFINISHED}")


def _image_folders(folder: Path) -> list[Path]:
    images = folder / IMAGES
    return sorted(path for path in images.iterdir() if path.is_dir()) if images.is_dir() else []


def _cut_torn_line(folder: Path, name: str, lines: Lines) -> str:
    if not lines.torn:
        return ""
    copy = _free_path(folder / TRASH / f"{name}.torn")
    make_folder(copy.parent)
    copy.write_bytes(lines.torn)
    cut_journal(folder / name, lines.size)
    return f"cut an unfinished line of {len(lines.torn):,} bytes off {name}"


def _free_path(path: Path) -> Path:
    """Return the path, or the first of path.1, path.2 ... that is free."""
    free, number = path, 0
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name}.{number}")
    return free


def _count(things: list[Path] | list[str], noun: str) -> str:
    return f"{len(things):,} {noun}{'' if len(things) == 1 else 's'}"
