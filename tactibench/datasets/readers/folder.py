"""From a table and the folders beside it to a recording: what all formats have in common."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactibench.contacts import Scene
from tactibench.datasets.labels import choose_indenter, role_columns, scenes_of
from tactibench.datasets.readers.files import FileFinder, check_frames, find_frames, frame_names
from tactibench.datasets.readers.options import AUTO, NONE, ImportOptions
from tactibench.datasets.readers.recording import FloatArray, Recording
from tactibench.datasets.readers.table import Table
from tactibench.datasets.splits import SUBSETS, Split

_MOSTLY_NUMBERS = 0.5
"""A column of which this share are numbers is meant as numbers; its other cells are mistakes."""


@dataclass(frozen=True, eq=False)
class KnownSamples:
    """Facts that a folder states itself, so that no option needs to say what labels mean.

    Attributes:
        labels: Label -> (N,) values, NaN where a frame has none.
        scenes: What was pressed in every frame.
        presses: Name of the press of every frame.
        samples: Other fields of every frame's sample.
        header: Fields of the header.
        dome_radius_mm: Radius of the pressed surface, inf where it is flat, None if unknown.
        columns: Columns of the table from which all this was read.
    """

    labels: Mapping[str, FloatArray]
    scenes: tuple[Scene | None, ...]
    presses: tuple[str, ...]
    samples: tuple[Mapping[str, Any], ...]
    header: Mapping[str, Any]
    dome_radius_mm: float | None
    columns: frozenset[str]


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
        label_columns: Columns that must be numbers; None: whichever are.
        rest_folder: Folder in which the undeformed frame is looked for.
        splits: Name -> split of the table's row numbers.
        about: File name -> what files beside the table say.
        known: Facts that the folder states itself.
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
    known: KnownSamples | None = None


def read_recording(content: FolderContent, options: ImportOptions) -> Recording:
    """Find the frames, read the labels, check every file.

    Raises:
        UserError: A frame, a label or a column is missing or wrong; the sentence names it.
    """
    table = content.table
    all_names = frame_names(table.path, table.cells[content.name_column])
    finder = FileFinder(content.folder)
    for path in (table.path, *(content.folder / name for name in content.about)):
        finder.find([path])
    files = find_frames(table.path, finder, content.frame_folders, all_names, options.missing)
    rows = [row for row, path in enumerate(files) if path is not None]
    paths = tuple(path for path in files if path is not None)
    rest = _find_rest(content.rest_folder, finder, set(paths))
    if options.press:
        table.column(options.press)
    known = content.known
    if (options.indenter, options.labels) != (AUTO, AUTO):
        known = None  # the options say how labels are read
    if known is not None:
        roles: dict[str, str] = {}
        labels = {name: values[rows] for name, values in known.labels.items()}
        scenes: Sequence[Scene | None] = [known.scenes[row] for row in rows]
        presses: Sequence[str] = known.presses
        used = known.columns
        radius = known.dome_radius_mm
    else:
        label_columns = _label_columns(content, options)
        labels = {column: table.numbers(column)[rows] for column in label_columns}
        indenter = choose_indenter(options, label_columns)
        roles = role_columns(options, indenter, labels, table.path)
        scenes = scenes_of(labels, roles, options, indenter) or [None] * len(rows)
        presses = all_names
        used = frozenset({*label_columns, content.name_column})
        radius = None if indenter == NONE else options.dome_radius_mm
    if options.press:
        presses = table.cells[options.press]
    kind, sha256 = check_frames(content.data, paths, rest)
    return Recording(
        format=content.format,
        generation=content.generation,
        folder=content.folder,
        table=table.path,
        names=tuple(all_names[row] for row in rows),
        paths=paths,
        frames=content.frame_folders[0],
        kind=kind,
        rest=rest,
        labels=labels,
        scenes=tuple(scenes),
        presses=tuple(presses[row] for row in rows),
        sha256=sha256,
        columns={"name": content.name_column, **roles},
        extra={
            name: tuple(table.cells[name][row] for row in rows)
            for name in table.columns
            if name not in used
        },
        samples=() if known is None else tuple(known.samples[row] for row in rows),
        header={} if known is None else known.header,
        splits=_renumber_splits(content.splits, rows),
        about=content.about,
        dome_radius_mm=radius,
        notes=_notes(content, len(all_names) - len(rows), paths, rest),
    )


def _label_columns(content: FolderContent, options: ImportOptions) -> tuple[str, ...]:
    table = content.table
    if options.labels != AUTO:
        return tuple(table.column(name.strip()) for name in options.labels.split(",") if name)
    if content.label_columns is not None:
        return content.label_columns
    others = {content.name_column, options.press}
    return tuple(
        name
        for name in table.columns
        if name not in others and table.numeric_share(name) >= _MOSTLY_NUMBERS
    )


def _find_rest(folder: Path, finder: FileFinder, listed: set[Path]) -> Path | None:
    """Return init_0.png, another *init*.png, or the image_0.png of newer recordings."""
    names = [folder / "init_0.png", *sorted(folder.glob("*init*.png")), folder / "image_0.png"]
    paths = (finder.find([path]) for path in names if path not in listed)
    return next((path for path in paths if path is not None), None)


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
    notes = []
    if skipped:
        notes.append(f"{_count(skipped, 'row')} of {content.table.path.name} left out: no file.")
    listed = {str(path) for path in (*paths, rest)}
    folders = {os.path.dirname(path) for path in map(str, paths)}  # noqa: PTH120 - of thousands
    there = (entry for folder in folders for entry in os.scandir(folder))
    others = sorted(e.name for e in there if e.name.endswith(".png") and e.path not in listed)
    if others:
        notes.append(
            f"{_count(len(others), 'PNG file')} that no row names left out, first {others[0]}."
        )
    if rest is None:
        notes.append(
            f"no frame of the undeformed sensor in {content.rest_folder.name}: models that follow "
            "pins from the rest layout cannot be run on it (add one as init_0.png)."
        )
    return tuple(notes)


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
