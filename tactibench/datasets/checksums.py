"""Checksums of the files of a closed data set, so that a flipped byte in any of them is noticed.

The journal holds the hashes of images and channels, and the header that of the journal and the
plan. ``checksums.json`` holds those of the header, the events and the splits. A data set that was
closed before it was written has none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from tactibench.datasets.schema import EVENTS, HEADER, SPLITS
from tactibench.errors import UserError
from tactibench.records import file_hash, read_checked_json, write_checked_json

CHECKSUMS = "checksums.json"


def write_checksums(folder: Path) -> None:
    """Write the checksums of the files of a data set that was closed."""
    files = [folder / HEADER, folder / EVENTS, *sorted((folder / SPLITS).glob("[!.]*.json"))]
    names = {path.relative_to(folder).as_posix(): path for path in files if path.is_file()}
    write_checked_json(folder / CHECKSUMS, {name: file_hash(path) for name, path in names.items()})


def changed_files(folder: Path, names: Iterable[str] | None = None) -> Iterator[str]:
    """Yield a sentence for every file that is missing or was changed.

    Args:
        folder: Folder of the data set.
        names: Names of the files to check; None: all.

    Raises:
        UserError: The checksums themselves are damaged.
    """
    path = folder / CHECKSUMS
    if not path.is_file():
        return
    checksums = read_checked_json(path)
    for name in checksums if names is None else names:
        if name not in checksums:
            continue
        try:
            same = file_hash(folder / name) == checksums[name]
        except FileNotFoundError:
            yield f"{folder / name} is missing; restore it from a copy."
            continue
        except OSError as error:
            yield f"{folder / name} cannot be read: {error.strerror or error}."
            continue
        if not same:
            yield (
                f"{folder / name} is not what it was when the data set was closed; restore it, or "
                f"delete {CHECKSUMS} to take the folder as it is."
            )


def refuse_changed(folder: Path, *names: str) -> None:
    """Raise UserError where one of the files is missing or was changed."""
    for sentence in changed_files(folder, names):
        raise UserError(sentence)
