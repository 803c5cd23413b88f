"""Formats of recorded folders: the table of each, and the folders of its frames.

bristol      targets.csv of the Bristol tactile stack. Generations differ in the column that names
             the frames (image_name; sensor_image), in the labels (pose_1 ... pose_6; pose_x ...
             pose_Rz, with shear_* and object_*), in the folder of the frames and in the files that
             say how they were taken (meta.json; *_params.json).
csv          one CSV file that names frames, with labels beside the names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactibench.datasets.options import AUTO, FRAME_FOLDERS, ImportOptions
from tactibench.datasets.schema import is_dataset
from tactibench.datasets.tables import Table, read_table
from tactibench.errors import UserError
from tactibench.png import read_file
from tactibench.records import read_json

TARGETS = ("targets.csv", "targets_images.csv")
NAME_COLUMNS = ("image_name", "sensor_image")
NAMES = ("file_name", "filename", *NAME_COLUMNS, "image", "frame", "file", "path", "name")
"""Columns of a CSV file that may name the frames, in order."""

BRISTOL, CSV, V1 = "bristol", "csv", "v1"

_ABOUT = ("meta.json", "*_params.json")
_LABEL = re.compile(r"(pose|move|shear|object)_([1-6]|[xyz]|R[xyz])")


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
        rest_folder: Folder in which the undeformed frame is looked for.
        label_columns: Columns that must be numbers; None: all columns that are mostly numbers.
        about: Name of a file beside the table -> its content.
        notes: Sentences about files beside the table that were left out.
    """

    format: str
    generation: str
    folder: Path
    table: Table
    data: bytes
    name_column: str
    frame_folders: tuple[Path, ...]
    rest_folder: Path
    label_columns: tuple[str, ...] | None = None
    about: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def find_targets(folder: Path) -> Path | None:
    """Return the table of a folder; None if the folder is no Bristol recording."""
    return next((folder / name for name in TARGETS if (folder / name).is_file()), None)


def recording_folder(folder: Path) -> Path:
    """Return the folder, or the one directly in it that alone is a Bristol recording."""
    if is_dataset(folder) or any(folder.glob("*.csv")):
        return folder
    inner = [child for child in folder.iterdir() if child.is_dir() and find_targets(child)]
    return inner[0] if len(inner) == 1 else folder


def read_bristol(folder: Path, options: ImportOptions) -> FolderContent:
    """Read the table of a folder and the files that say how its frames were taken.

    Raises:
        UserError: The table or a column is missing, or cannot be read.
    """
    path = folder / options.table if options.table else find_targets(folder)
    if path is None or not path.is_file():
        raise UserError(f"{folder} holds no {options.table or TARGETS[0]}; name another folder.")
    data = read_file(path)
    table = read_table(path, data)
    name = table.column(options.column) if options.column else table.column(*NAME_COLUMNS)
    frames = _frames_folder(folder, options.frames)
    columns = tuple(column for column in table.columns if _LABEL.fullmatch(column))
    lettered = any(column.partition("_")[2] in ("x", "Rx") for column in columns)
    about, notes = {}, []
    for file in sorted(file for pattern in _ABOUT for file in folder.glob(pattern)):
        try:
            about[file.name] = read_json(file)
        except UserError as error:
            notes.append(f"left out: {error}")
    return FolderContent(
        BRISTOL,
        f"{name}, pose_{'x..pose_Rz' if lettered else '1..pose_6'}, {frames.name}",
        folder,
        table,
        data,
        name,
        (frames, folder),  # older tables name frames from the folder above theirs
        frames,
        columns,
        about=about,
        notes=tuple(notes),
    )


def _frames_folder(folder: Path, name: str) -> Path:
    names = FRAME_FOLDERS if name == AUTO else (name,)
    for candidate in names:
        if (folder / candidate).is_dir():
            return folder / candidate
    if name == AUTO and any(folder.glob("*.png")):  # frames beside the table
        return folder
    raise UserError(f"{folder} holds no folder of frames; looked for {', '.join(names)}.")


def read_csv(folder: Path, options: ImportOptions) -> FolderContent:
    """Read a folder whose one CSV file names frames, with labels beside the names.

    Raises:
        UserError: There is no table or there are several, the table cannot be read, or the folder
            of frames does not exist.
    """
    targets = find_targets(folder)
    path = _table_path(folder, options.table or (targets.name if targets else ""))
    data = read_file(path)
    table = read_table(path, data)
    name = table.column(options.column) if options.column else table.column(*NAMES)
    places = frame_places(folder)
    if options.frames != AUTO:
        places = (folder / options.frames,)
        if not places[0].is_dir():
            raise UserError(f"{places[0]} is no folder; name that of frames with --param frames.")
    first = table.cells[name][0].strip().replace("\\", "/")
    frames = next((place for place in places if first and (place / first).is_file()), places[0])
    return FolderContent(CSV, f"{path.name}, {name}", folder, table, data, name, places, frames)


def frame_places(folder: Path) -> tuple[Path, ...]:
    """Return a folder and those in it, the usual folders of frames first."""
    below = sorted(path for path in folder.iterdir() if path.is_dir())
    usual = [folder / name for name in FRAME_FOLDERS if folder / name in below]
    return (folder, *usual, *(path for path in below if path not in usual))


def _table_path(folder: Path, name: str) -> Path:
    paths = [folder / name] if name else sorted(folder.glob("*.csv"))
    if len(paths) == 1 and paths[0].is_file():
        return paths[0]
    if name or not paths:
        raise UserError(f"{folder} holds no {name or 'CSV file'}; name another folder.")
    names = ", ".join(path.name for path in paths)
    raise UserError(
        f"{folder} holds several CSV files ({names}); make a data set of them with `tactibench "
        f"data import {folder} NEW --param table=FILE --guess` (channels: --param channels=FILE, "
        "too)."
    )


READERS = {BRISTOL: read_bristol, CSV: read_csv}
FORMATS = tuple(READERS)
"""Formats that can be imported."""


def find_format(folder: Path) -> str:
    """Return the format of a folder: "v1" or one of FORMATS.

    Raises:
        UserError: The folder has none of these formats.
    """
    check_folder(folder)
    if is_dataset(folder):
        return V1
    if (targets := find_targets(folder)) is not None:
        columns = read_table(targets, read_file(targets)).columns
        return BRISTOL if set(NAME_COLUMNS) & set(columns) else CSV
    if any(folder.glob("*.csv")):
        return CSV
    raise UserError(
        f"{folder} holds no {TARGETS[0]}, no dataset.json and no other CSV file; name a folder of "
        "recorded frames."
    )


def check_folder(folder: Path) -> None:
    """Check that this is a folder that can be listed.

    Raises:
        UserError: It is none.
    """
    if not folder.exists():
        raise UserError(f"{folder} does not exist; give a folder of recorded frames.")
    if not folder.is_dir():
        raise UserError(f"{folder} is a file; give the folder that holds it.")
    try:
        next(folder.iterdir(), None)
    except OSError as error:
        raise UserError(f"{folder} cannot be listed: {error.strerror}.") from None
