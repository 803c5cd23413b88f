"""A recording from a table and the folders beside it: the steps that all formats have in common.

Frames are looked for inside their folder only; every file is read once, checked and hashed.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Scene
from tactibench.datasets.labels import choose_indenter, role_columns, scenes_of
from tactibench.datasets.readers.camera import prepare_frames
from tactibench.datasets.readers.options import AUTO, NONE, REFUSE, ImportOptions
from tactibench.datasets.readers.recording import FloatArray, Recording
from tactibench.datasets.readers.table import Table
from tactibench.datasets.splits import SUBSETS, Split
from tactibench.datasets.tips import may_be_empty, named_columns
from tactibench.errors import UserError
from tactibench.png import ImageKind, check_png, read_file

_MOSTLY_NUMBERS = 0.5
"""A column of which this share are numbers is meant as numbers; its other cells are mistakes."""
_SAME_PLACE = 0.01
"""Numbers that are no further apart are one place, mm or deg: robots come back to a few um."""
_BITS_AT, _MOST_BITS = 24, 8
"""Place of the byte in a PNG that holds the bits per channel, and the most bits of a frame."""


@dataclass(frozen=True, eq=False)
class FrameLabels:
    """The labels of N frames, and the scenes that they describe.

    Attributes:
        labels: Label -> (N,) values, NaN where a frame has none.
        scenes: Scene of every frame; None where it is not known.
        presses: Name of the press of every frame.
        dome_radius_mm: Radius of the pressed surface, inf where it is flat, None if unknown.
        columns: Columns of the table from which all this was read.
        roles: Role, such as "depth" -> column.
        samples: Other fields of every frame's sample; empty where the table has none.
        header: Fields of a data set's header.
    """

    labels: Mapping[str, FloatArray]
    scenes: Sequence[Scene | None]
    presses: Sequence[str]
    dome_radius_mm: float | None
    columns: frozenset[str]
    roles: Mapping[str, str] = field(default_factory=dict)
    samples: tuple[Mapping[str, Any], ...] = ()
    header: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class FolderContent:
    """The content of a folder, as the reader of one format sees it.

    Attributes:
        format: Name of the format.
        generation: Variant of the format, in words.
        folder: The folder.
        table: Its table.
        data: Bytes of the table's file.
        name_column: Column that names the frames.
        frame_folders: Folders in which frames are looked for, in order.
        label_columns: Columns that must be numbers; None: all columns that are mostly numbers.
        rest_folder: Folder in which the undeformed frame is looked for.
        splits: Name -> split of the table's row numbers.
        about: Name of a file beside the table -> its content.
        labels: Labels where the folder itself states their meaning; None: the options state it.
        notes: Sentences about files beside the table that were left out.
    """

    format: str
    generation: str
    folder: Path
    table: Table
    data: bytes
    name_column: str
    frame_folders: tuple[Path, ...]
    label_columns: tuple[str, ...] | None
    rest_folder: Path
    splits: Mapping[str, Split] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)
    labels: FrameLabels | None = None
    notes: tuple[str, ...] = ()


def read_recording(content: FolderContent, options: ImportOptions) -> Recording:
    """Find the frames, read the labels, check every file.

    Raises:
        UserError: A frame, a label or a column is missing or wrong; the sentence names it.
    """
    table = content.table
    names = frame_names(table.path, table.cells[content.name_column])
    finder = FileFinder(content.folder)
    for path in (table.path, *(content.folder / name for name in content.about)):
        finder.find([path])
    files = _find_frames(content, finder, names, options.missing)
    rows = [row for row, path in enumerate(files) if path is not None]
    paths = tuple(path for path in files if path is not None)
    rest = _find_rest(content.rest_folder, finder, set(paths))
    labels = content.labels or read_labels(content, names, options)
    presses = read_presses(table, options) or labels.presses
    kind, sha256 = check_frames(content.data, paths, rest)
    recording = Recording(
        format=content.format,
        generation=content.generation,
        folder=content.folder,
        table=table.path,
        names=tuple(names[row] for row in rows),
        paths=paths,
        frames=content.frame_folders[0],
        stored=kind,
        rest=rest,
        labels={name: values[rows] for name, values in labels.labels.items()},
        scenes=tuple(labels.scenes[row] for row in rows),
        presses=tuple(presses[row] for row in rows),
        sha256=sha256,
        columns={"name": content.name_column, **labels.roles},
        extra={
            name: tuple(table.cells[name][row] for row in rows)
            for name in table.columns
            if name not in labels.columns
        },
        samples=tuple(labels.samples[row] for row in rows) if labels.samples else (),
        header=labels.header,
        splits=_renumber_splits(content.splits, rows),
        about=content.about,
        dome_radius_mm=labels.dome_radius_mm,
        notes=_notes(content, len(names) - len(rows), paths, rest),
    )
    return prepare_frames(recording, options.light)


def read_labels(
    content: FolderContent, names: Sequence[str], options: ImportOptions
) -> FrameLabels:
    """Read the labels as the options say; every frame is a press of its own.

    Args:
        content: The content of the folder.
        names: Name of every frame.
        options: Names of columns, and the meaning of the labels.

    Raises:
        UserError: A column is missing, a cell is no number, or labels describe no scene that can
            be.
    """
    table = content.table
    columns = _label_columns(content, options)
    indenter = choose_indenter(options, columns)
    empty = may_be_empty(options, indenter)
    needed = empty | named_columns(options, indenter)  # read even where cells are no numbers
    columns = tuple(dict.fromkeys([*columns, *(c for c in table.columns if c in needed)]))
    labels = {column: table.numbers(column, allow_empty=column in empty) for column in columns}
    roles = role_columns(options, indenter, labels, table.path)
    return FrameLabels(
        labels,
        scenes_of(labels, roles, options, indenter, table.path) or [None] * len(names),
        names,
        None if indenter == NONE else options.surface_radius_mm,
        frozenset({*columns, content.name_column}),
        roles,
    )


def read_presses(table: Table, options: ImportOptions) -> tuple[str, ...] | None:
    """Return the press of every row: rows that agree in all named columns share one.

    Texts agree where they are equal, numbers where a robot came back to one place. A press is named
    after the cells of its first row. None where the options name no column.
    """
    if not options.press:
        return None
    columns = [table.column(name.strip()) for name in options.press.split(",")]
    cells = [" ".join(row) for row in zip(*(table.cells[name] for name in columns), strict=True)]
    numbers = [
        table.numbers(name)
        if table.numeric_share(name) == 1
        else np.unique(list(table.cells[name]), return_inverse=True)[1]
        for name in columns
    ]
    first: dict[int, str] = {}
    groups = _same_places(np.column_stack(numbers))
    return tuple(
        first.setdefault(group, cell) for group, cell in zip(groups.tolist(), cells, strict=True)
    )


def _same_places(points: FloatArray) -> npt.NDArray[np.int64]:
    """Return the (N,) groups of (N, K) points that are one place along every axis."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    places, place_of = np.unique(points, axis=0, return_inverse=True)
    close = cKDTree(places).query_pairs(_SAME_PLACE, p=np.inf, output_type="ndarray")
    count = len(places)
    links = coo_array((np.ones(len(close)), (close[:, 0], close[:, 1])), shape=(count, count))
    _, group = connected_components(links, directed=False)
    return np.asarray(group[place_of.ravel()], dtype=np.int64)


def _label_columns(content: FolderContent, options: ImportOptions) -> tuple[str, ...]:
    table = content.table
    if options.labels != AUTO:
        return tuple(table.column(name.strip()) for name in options.labels.split(",") if name)
    if content.label_columns is not None:
        return content.label_columns
    others = {content.name_column, options.press, options.join}
    return tuple(
        name
        for name in table.columns
        if name not in others and table.numeric_share(name) >= _MOSTLY_NUMBERS
    )


def frame_names(path: Path, cells: Sequence[str]) -> tuple[str, ...]:
    """Return the names of frames with '/' as separator, in the order of the table.

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
    """Search for files of one folder; links are followed inside it only."""

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


def _find_frames(
    content: FolderContent, finder: FileFinder, names: Sequence[str], missing: str
) -> list[Path | None]:
    """Return the file of every name; where ``missing`` is SKIP, None for a missing file."""
    folders = content.frame_folders
    paths = [finder.find(folder / name for folder in folders) for name in names]
    absent = [name for name, path in zip(names, paths, strict=True) if path is None]
    if absent and (missing == REFUSE or len(absent) == len(names)):
        many = len(absent) > 1
        raise UserError(
            f"{content.table.path} names {len(absent)} frame{'s' if many else ''} that "
            f"{'are' if many else 'is'} not in {folders[0]}, first {absent[0]}; "
            "add the files or remove their rows."
        )
    return paths


def _find_rest(folder: Path, finder: FileFinder, listed: set[Path]) -> Path | None:
    """Return init_0.png, another *init*.png, or the image_0.png of newer recordings."""
    names = [folder / "init_0.png", *sorted(folder.glob("*init*.png")), folder / "image_0.png"]
    paths = (finder.find([path]) for path in names if path not in listed)
    return next((path for path in paths if path is not None), None)


def check_frames(table: bytes, paths: Sequence[Path], rest: Path | None) -> tuple[ImageKind, str]:
    """Read every file once.

    Args:
        table: Bytes of the table.
        paths: Files of the frames, at least one.
        rest: File of the undeformed frame.

    Returns:
        Size and colours of every frame, and the sha256 over the table, all frames and the rest
        frame.

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


def _renumber_splits(splits: Mapping[str, Split], rows: Sequence[int]) -> dict[str, Split]:
    """Return the splits in the numbers of the rows that are left."""
    number_of = {row: number for number, row in enumerate(rows)}
    return {
        name: Split(
            *(
                tuple(number_of[row] for row in getattr(split, subset) if row in number_of)
                for subset in SUBSETS
            )
        )
        for name, split in splits.items()
    }


def _notes(
    content: FolderContent, skipped: int, paths: Sequence[Path], rest: Path | None
) -> tuple[str, ...]:
    notes = [*content.notes]
    if skipped:
        notes.append(f"{_count(skipped, 'row')} of {content.table.path.name} left out: no file.")
    listed = {str(path) for path in (*paths, rest)}
    folders = {os.path.dirname(path) for path in map(str, paths)}  # noqa: PTH120 - of thousands
    entries = (entry for folder in folders for entry in os.scandir(folder))
    others = sorted(e.name for e in entries if e.name.endswith(".png") and e.path not in listed)
    if others:
        notes.append(
            f"{_count(len(others), 'PNG file')} that no row names left out, first {others[0]}."
        )
    return tuple(notes)


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
