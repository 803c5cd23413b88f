"""What an interrupted writer leaves: a torn line, images that no line names, temporary files.

Nothing that was acknowledged is touched. Unfinished temporary files are removed, all else is moved
to .trash/.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from tactibench.datasets.v1.content import Content
from tactibench.datasets.v1.durable import make_folder
from tactibench.datasets.v1.journal import Lines, cut
from tactibench.datasets.v1.layout import (
    EVENTS,
    HEADER,
    IMAGES,
    JOURNAL,
    PLAN,
    SPLITS,
    TRASH,
    UNFINISHED,
    image_id,
)


def repair(folder: Path, content: Content) -> tuple[str, ...]:
    """Mend an open data set whose lock is held; sentences on what was done."""
    done = [_cut(folder, JOURNAL, content.journal), _cut(folder, EVENTS, content.event_lines)]
    named = {sample.file_name for sample in content.samples}
    orphans = [name for name in sample_images(folder) if name not in named]
    for name in orphans:
        target = _free(folder / TRASH / name)
        make_folder(target.parent)
        (folder / name).rename(target)
    if orphans:
        done.append(f"moved {_count(orphans, 'image')} that no line names to {TRASH}/")
    parts = list(unfinished(folder))
    for part in parts:
        part.unlink()
    if parts:
        done.append(f"removed {_count(parts, 'unfinished file')}")
    return tuple(sentence for sentence in done if sentence)


def needs_repair(folder: Path, content: Content) -> bool:
    """Whether an interrupted writer (or one at work) left anything."""
    if content.journal.torn or content.event_lines.torn or any(unfinished(folder)):
        return True
    return not {sample.file_name for sample in content.samples}.issuperset(sample_images(folder))


def sample_images(folder: Path) -> Iterator[str]:
    """Names of all images of samples on the disk, whether a line names them or not."""
    for shard in _shards(folder):
        with os.scandir(shard) as entries:
            for entry in entries:
                name = f"{IMAGES}/{shard.name}/{entry.name}"
                if image_id(name) is not None:
                    yield name


def unfinished(folder: Path) -> Iterator[Path]:
    """Temporary files of writers that did not come to rename them."""
    for name in (HEADER, PLAN, f"{SPLITS}/"):  # see records.files.atomic
        place, _, stem = name.rpartition("/")
        yield from (folder / place).glob(f".{stem}*.*")
    for shard in _shards(folder):
        yield from shard.glob(f".*{UNFINISHED}")


def _shards(folder: Path) -> list[Path]:
    images = folder / IMAGES
    return sorted(path for path in images.iterdir() if path.is_dir()) if images.is_dir() else []


def _cut(folder: Path, name: str, lines: Lines) -> str:
    if not lines.torn:
        return ""
    kept = _free(folder / TRASH / f"{name}.torn")
    make_folder(kept.parent)
    kept.write_bytes(lines.torn)
    cut(folder / name, lines.size)
    return f"cut an unfinished line of {len(lines.torn):,} bytes off {name}"


def _free(path: Path) -> Path:
    """The path, or the first of path.1, path.2 ... that is not taken."""
    free, number = path, 0
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name}.{number}")
    return free


def _count(things: list[Path] | list[str], word: str) -> str:
    return f"{len(things):,} {word}{'' if len(things) == 1 else 's'}"
