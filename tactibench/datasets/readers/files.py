"""Frames that a table names: found inside their folder, checked, hashed."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath

from tactibench.datasets.readers.options import REFUSE
from tactibench.errors import UserError
from tactibench.png import ImageKind, check_png, read_file

_BITS_AT, _MOST_BITS = 24, 8
"""Where a PNG says how many bits a channel has, and the most that a frame may have."""


def frame_names(path: Path, cells: Sequence[str]) -> tuple[str, ...]:
    """Return the names of frames with '/' as separator, in the order of the table.

    Args:
        path: The table, for errors; rows are counted from 1 below its header.
        cells: Names as the table writes them.

    Raises:
        UserError: A name is empty, leads out of its folder, or is listed twice.
    """
    row_of: dict[str, int] = {}
    for row, cell in enumerate(cells, start=1):
        name = _relative_name(path, row, cell)
        if name in row_of:
            raise UserError(
                f"{path} rows {row_of[name]} and {row} both name the frame {name}; "
                "a frame may be listed once."
            )
        row_of[name] = row
    return tuple(row_of)


def _relative_name(path: Path, row: int, cell: str) -> str:
    text = cell.strip().replace("\\", "/")
    if not text:
        raise UserError(f"{path} row {row} names no frame; every row needs a file name.")
    name = PurePosixPath(text)
    if name.is_absolute() or ".." in name.parts or ":" in text or "\0" in text:
        raise UserError(
            f"{path} row {row} names {cell!r}; a frame's name must be relative, stay inside the "
            "frames folder and hold no ':'."
        )
    return str(name)


class FileFinder:
    """Finds files of one folder; links are followed inside it only."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._real = folder.resolve()
        self._checked: set[Path] = set()

    def find(self, places: Iterable[Path]) -> Path | None:
        """Return the first of the places that is a file.

        Raises:
            UserError: A link leads out of the folder or runs in a circle.
        """
        for place in places:
            if place.parent not in self._checked and place.parent.exists():
                self._check(place.parent)
                self._checked.add(place.parent)
            try:
                mode = os.lstat(place).st_mode
            except OSError:
                continue
            if stat.S_ISLNK(mode):
                self._check(place)
                mode = stat.S_IFREG if place.is_file() else 0
            if stat.S_ISREG(mode):
                return place
        return None

    def _check(self, place: Path) -> None:
        try:
            inside = place.resolve(strict=True).is_relative_to(self._real)
        except FileNotFoundError:
            return  # a link to nothing is a file that is missing
        except (OSError, RuntimeError):
            raise UserError(
                f"{place} is a link that runs in a circle; replace it by the file."
            ) from None
        if not inside:
            raise UserError(
                f"{place} is a link that leads out of {self._folder}, where nothing is read; "
                "replace it by the file."
            )


def find_frames(
    table: Path, finder: FileFinder, folders: Sequence[Path], names: Sequence[str], missing: str
) -> list[Path | None]:
    """Return the file of every name, in the first of the folders that has it.

    Args:
        table: The table that names them, for errors.
        finder: Finder of the recording's folder.
        folders: Folders in which frames may lie, in order.
        names: Names of the frames, relative to the folders.
        missing: REFUSE, or SKIP to leave None for a missing file.

    Raises:
        UserError: Names are no files, and none may be skipped or all of them would be.
    """
    paths = [finder.find(folder / name for folder in folders) for name in names]
    absent = [name for name, path in zip(names, paths, strict=True) if path is None]
    if absent and (missing == REFUSE or len(absent) == len(names)):
        many = len(absent) > 1
        raise UserError(
            f"{table} names {len(absent)} frame{'s' if many else ''} that "
            f"{'are' if many else 'is'} not in {folders[0]}, first {absent[0]}; "
            "add the files or remove their rows."
        )
    return paths


def check_frames(table: bytes, paths: Sequence[Path], rest: Path | None) -> tuple[ImageKind, str]:
    """Read every file once.

    Args:
        table: Bytes of the table.
        paths: Files of the frames, at least one.
        rest: File of the undeformed frame.

    Returns:
        What every frame is, and the sha256 over the table, every frame and the rest frame.

    Raises:
        UserError: A frame is no sound PNG of 8 bits, or differs from the others.
    """
    digest = hashlib.sha256(table)
    first: ImageKind | None = None
    for path in (*paths, rest):
        if path is None:
            continue
        data = read_file(path)
        kind = check_png(path, data)
        if data[_BITS_AT] > _MOST_BITS:
            raise UserError(
                f"{path} has {data[_BITS_AT]} bits a pixel; frames have 8: convert them first."
            )
        first = first or kind
        if kind != first:
            raise UserError(
                f"{path} is {kind}, but {paths[0].name} is {first}; "
                "all frames of a recording, the rest frame included, must be alike."
            )
        # The length keeps two files from passing for one.
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    assert first is not None, "a table has at least one row"  # noqa: S101
    return first, digest.hexdigest()
