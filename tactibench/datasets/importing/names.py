"""Names of frames as tables write them, and the files they name: never outside their folder."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath

from tactibench.errors import UserError

REFUSE, SKIP = "refuse", "skip"


def frame_names(path: Path, cells: Sequence[str]) -> tuple[str, ...]:
    """The names with '/' as separator, in file order.

    Rows are counted from 1 below the header. Raises UserError for an empty name, one that leads out
    of its folder, or one that is listed twice.
    """
    seen: dict[str, int] = {}
    for row, cell in enumerate(cells, start=1):
        name = _inside(path, row, cell)
        if name in seen:
            raise UserError(
                f"{path} rows {seen[name]} and {row} both name the frame {name}; "
                "a frame may be listed once."
            )
        seen[name] = row
    return tuple(seen)


def _inside(path: Path, row: int, cell: str) -> str:
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


class Finder:
    """Files of one folder; links are followed inside it only."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._real = folder.resolve()
        self._sound: set[Path] = set()

    def find(self, places: Iterable[Path]) -> Path | None:
        """The first of the places that is a file.

        Raises UserError for one that is reached through a link out of the folder, or in a circle.
        """
        for place in places:
            if place.parent not in self._sound and place.parent.exists():
                self._check(place.parent)
                self._sound.add(place.parent)
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
    table: Path, finder: Finder, folders: Sequence[Path], names: Sequence[str], missing: str
) -> list[Path | None]:
    """The file of every name, in the first of the folders that has it.

    missing: REFUSE or SKIP, which leaves None. Raises UserError where names are no files, and none
    may be skipped, or all of them would be.
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
