"""From a table and the folders beside it to a recording; what all formats have in common."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactibench.datasets.importing.content import read_content
from tactibench.datasets.importing.geometry import NONE, indenter_of, roles_of, scenes_of
from tactibench.datasets.importing.names import Finder, find_frames, frame_names
from tactibench.datasets.importing.options import AUTO, ImportOptions
from tactibench.datasets.importing.recording import Recording
from tactibench.datasets.importing.table import Table
from tactibench.errors import UserError

_MOSTLY = 0.5
"""A column of which this share are numbers is meant as numbers."""


@dataclass(frozen=True, eq=False)
class Source:
    """What a format's reader found. data: bytes of the table file. name_column: of the frames.

    folders: where frames are looked for, in order. labels: columns that must be numbers; None:
    whichever are. rest: folder in which
    the undeformed frame is looked for. parts: name of a split -> rows.
    """

    format: str
    generation: str
    folder: Path
    table: Table
    data: bytes
    name_column: str
    folders: tuple[Path, ...]
    labels: tuple[str, ...] | None
    rest: Path | None = None
    parts: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)


def assemble(source: Source, options: ImportOptions) -> Recording:
    """Find the frames, read the labels, check every file. Raises UserError."""
    table = source.table
    names = frame_names(table.path, table.cells[source.name_column])
    finder = Finder(source.folder)
    for path in (table.path, *(source.folder / name for name in source.about)):
        finder.find([path])
    found = find_frames(table.path, finder, source.folders, names, options.missing)
    rows = [row for row, path in enumerate(found) if path is not None]
    paths = tuple(path for path in found if path is not None)
    rest = _rest(source.rest, finder, set(paths)) if source.rest else None
    wanted = _label_columns(source, options)
    numbers = {column: table.numbers(column)[rows] for column in wanted}
    indenter = indenter_of(options, wanted)
    roles = roles_of(options, indenter, numbers, table.path)
    scenes = scenes_of(numbers, roles, options, indenter)
    content = read_content(source.data, paths, rest)
    if options.press and options.press not in table.cells:
        raise UserError(
            f"{table.path} has no column {options.press!r} for the presses; its columns are "
            f"{', '.join(table.columns)}."
        )
    others = {
        name: table.cells[name]
        for name in table.columns
        if name not in {*wanted, source.name_column}
    }
    chosen = tuple(names[row] for row in rows)
    presses = table.cells[options.press] if options.press else names
    return Recording(
        source.format,
        source.generation,
        source.folder,
        table.path,
        chosen,
        paths,
        source.folders[0],
        content.kind,
        rest,
        numbers,
        scenes or (None,) * len(rows),
        tuple(presses[row] for row in rows),
        content.sha256,
        {"name": source.name_column, **roles},
        {name: tuple(cells[row] for row in rows) for name, cells in others.items()},
        _kept(source.parts, rows),
        source.about,
        None if indenter == NONE else options.dome_radius_mm,
        _notes(source, len(names) - len(rows), paths, rest),
    )


def _label_columns(source: Source, options: ImportOptions) -> tuple[str, ...]:
    table = source.table
    if options.labels != AUTO:
        return tuple(table.column(name.strip()) for name in options.labels.split(",") if name)
    if source.labels is not None:
        return source.labels
    left_out = {source.name_column, options.press}
    return tuple(
        name for name in table.columns if name not in left_out and table.numeric(name) >= _MOSTLY
    )


def _rest(folder: Path, finder: Finder, listed: set[Path]) -> Path | None:
    """init_0.png, another *init*.png, or the image_0.png of newer recordings."""
    names = [folder / "init_0.png", *sorted(folder.glob("*init*.png")), folder / "image_0.png"]
    found = (finder.find([path]) for path in names if path not in listed)
    return next((path for path in found if path is not None), None)


def _kept(parts: Mapping[str, tuple[int, ...]], rows: Sequence[int]) -> dict[str, tuple[int, ...]]:
    """The parts in the numbers of the rows that are left."""
    at = {row: number for number, row in enumerate(rows)}
    return {name: tuple(at[row] for row in members if row in at) for name, members in parts.items()}


def _notes(
    source: Source, skipped: int, paths: Sequence[Path], rest: Path | None
) -> tuple[str, ...]:
    notes = []
    if skipped:
        notes.append(f"{_count(skipped, 'row')} of {source.table.path.name} left out: no file.")
    listed = {str(path) for path in (*paths, rest)}
    folders = {os.path.dirname(path) for path in map(str, paths)}  # noqa: PTH120 - of thousands
    there = (entry for folder in folders for entry in os.scandir(folder))
    others = sorted(e.name for e in there if e.name.endswith(".png") and e.path not in listed)
    if others:
        notes.append(
            f"{_count(len(others), 'PNG file')} that no row names left out, first {others[0]}."
        )
    if source.rest is not None and rest is None:
        notes.append(
            f"no frame of the undeformed sensor in {source.rest.name}: models that follow pins "
            "from the rest layout cannot be run on it (add one as init_0.png)."
        )
    return tuple(notes)


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"
