"""Recorded folders of frames: their table, the files of the frames, and the labels.

bristol      targets.csv of the Bristol tactile stack. Generations differ in the column that names
             the frames (image_name; sensor_image), in the labels (pose_1 ... pose_6; pose_x ...
             pose_Rz, with shear_* and object_*), in the folder of the frames and in the files that
             say how they were taken (meta.json; *_params.json).
csv          one CSV file that names frames, with labels beside the names.

Frames are looked for inside their folder only; every file is read once, checked and hashed.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.datasets.labels import (
    CONTACT_COLUMNS,
    choose_indenter,
    normal_forces,
    role_columns,
    scenes_of,
    signed_column,
    tip_columns,
)
from tactibench.datasets.options import AUTO, FRAME_FOLDERS, NONE, REFUSE, ImportOptions
from tactibench.datasets.recording import FloatArray, Recording, prepare_frames
from tactibench.datasets.schema import Forces, is_dataset
from tactibench.datasets.tables import Table, read_table
from tactibench.errors import UserError
from tactibench.png import ImageKind, check_png, read_file
from tactibench.records import read_json

TARGETS = ("targets.csv", "targets_images.csv")
NAME_COLUMNS = ("image_name", "sensor_image")
NAMES = ("file_name", "filename", *NAME_COLUMNS, "image", "frame", "file", "path", "name")
"""Columns of a CSV file that may name the frames, in order."""

_ABOUT = ("meta.json", "*_params.json")
_LABEL = re.compile(r"(pose|move|shear|object)_([1-6]|[xyz]|R[xyz])")
_MOSTLY_NUMBERS = 0.5
"""A column of which this share are numbers is meant as numbers; its other cells are mistakes."""
_SAME_PLACE = 0.01
"""Numbers that are no further apart are one place, mm or deg: robots come back to a few um."""
_BITS_AT, _MOST_BITS = 24, 8
"""Place of the byte in a PNG that holds the bits per channel, and the most bits of a frame."""


def find_targets(folder: Path) -> Path | None:
    """Return the table of a folder; None if the folder is no Bristol recording."""
    return next((folder / name for name in TARGETS if (folder / name).is_file()), None)


def recording_folder(folder: Path) -> Path:
    """Return the folder, or the one directly in it that alone is a Bristol recording.

    Raises:
        UserError: This is no folder, or it cannot be listed.
    """
    if not folder.is_dir():
        what = "is a file; give the folder that holds it" if folder.exists() else "does not exist"
        raise UserError(f"{folder} {what}.")
    try:
        below = list(folder.iterdir())
    except OSError as error:
        raise UserError(f"{folder} cannot be listed: {error.strerror}.") from None
    if is_dataset(folder) or any(folder.glob("*.csv")):
        return folder
    inner = [child for child in below if child.is_dir() and find_targets(child)]
    return inner[0] if len(inner) == 1 else folder


def frame_places(folder: Path) -> tuple[Path, ...]:
    """Return a folder and those in it, the usual folders of frames first."""
    below = sorted(path for path in folder.iterdir() if path.is_dir())
    usual = [folder / name for name in FRAME_FOLDERS if folder / name in below]
    return (folder, *usual, *(path for path in below if path not in usual))


def read_frames(folder: Path, options: ImportOptions) -> Recording:
    """Read the table of a folder and its labels, find the frames and check every file.

    Raises:
        UserError: The table, a frame, a label or a column is missing or wrong; the sentence names
            it.
    """
    path = _table_path(folder, options.table)
    data = read_file(path)
    table = read_table(path, data)
    column = table.column(options.column) if options.column else table.column(*NAMES)
    bristol = path.name in TARGETS and column in NAME_COLUMNS
    names = frame_names(path, table.cells[column])
    places = _places(folder, options, bristol=bristol)
    frames = next((place for place in places if (place / names[0]).is_file()), places[0])
    files = _find_frames(path, names, places, options)
    rows = [row for row, file in enumerate(files) if file is not None]
    paths = tuple(file for file in files if file is not None)
    rest = _find_rest(frames, set(paths))
    columns = [name for name in table.columns if _LABEL.fullmatch(name)] if bristol else None
    facts = read_labels(table, names, rows, options, name=column, columns=columns)
    kind, sha256 = check_frames(data, paths, rest)
    about, notes = _read_about(folder)
    there = [name for name in CONTACT_COLUMNS if name in table.columns]
    lacking = [name for name in CONTACT_COLUMNS if name not in facts["labels"]]
    if there and lacking and options.indenter == AUTO:
        notes.append(
            f"{path.name} has {', '.join(there)}, but its labels are no contacts: "
            f"{', '.join(lacking)} is missing or holds no numbers."
        )
    if left_out := len(names) - len(rows):
        notes.append(f"rows of {path.name} left out, no file: {left_out:,}.")
    recording = Recording(
        format="bristol" if bristol else "csv",
        generation=f"{path.name}, {column}",
        folder=folder,
        table=path,
        paths=paths,
        frames=frames,
        stored=kind,
        rest=rest,
        sha256=sha256,
        about=about,
        notes=tuple(notes),
        **facts,
    )
    return prepare_frames(recording, options.light)


def _table_path(folder: Path, name: str) -> Path:
    if name:
        if not (folder / name).is_file():
            raise UserError(f"{folder} holds no {name}; name another folder.")
        return folder / name
    if targets := find_targets(folder):
        return targets
    paths = sorted(folder.glob("*.csv"))
    if not paths:
        raise UserError(
            f"{folder} holds no {TARGETS[0]}, no dataset.json and no other CSV file; name a folder "
            "of recorded frames."
        )
    if len(paths) > 1:
        names = ", ".join(path.name for path in paths)
        raise UserError(
            f"{folder} holds several CSV files ({names}); make a data set of them with `tactibench "
            f"data import {folder} NEW --param table=FILE --guess` (channels: --param "
            "channels=FILE, too)."
        )
    return paths[0]


def _read_about(folder: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the content of files that say how frames were taken, and notes on damaged ones."""
    about, notes = {}, []
    for file in sorted(file for pattern in _ABOUT for file in folder.glob(pattern)):
        try:
            about[file.name] = read_json(file)
        except UserError as error:
            notes.append(f"left out: {error}")
    return about, notes


def frame_names(path: Path, cells: Iterable[str]) -> tuple[str, ...]:
    """Return the names of frames with '/' as separator, in the order of the table.

    Raises:
        UserError: A name is empty, leads out of its folder, or is listed twice.
    """
    row_of: dict[str, int] = {}
    for row, cell in enumerate(cells, start=1):
        text = cell.strip().replace("\\", "/")
        if not text:
            raise UserError(f"{path} row {row} names no frame; every row needs a file name.")
        name = PurePosixPath(text)
        if name.is_absolute() or ".." in name.parts or ":" in text or "\0" in text:
            raise UserError(
                f"{path} row {row} names {cell!r}; a frame's name must be relative, stay inside "
                "the frames folder and hold no ':'."
            )
        if (first := row_of.setdefault(str(name), row)) != row:
            raise UserError(
                f"{path} rows {first} and {row} both name the frame {name}; a frame may be listed "
                "once."
            )
    return tuple(row_of)


def _places(folder: Path, options: ImportOptions, *, bristol: bool) -> tuple[Path, ...]:
    """Return the folders in which frames are looked for, in order."""
    if options.frames != AUTO:
        if not (folder / options.frames).is_dir():
            raise UserError(
                f"{folder / options.frames} is no folder; name that of frames with --param frames."
            )
        return (folder / options.frames,)
    if bristol:  # older tables name frames from the folder above theirs
        usual = (folder / name for name in FRAME_FOLDERS if (folder / name).is_dir())
        return (next(usual, folder), folder)
    return frame_places(folder)


def _find_frames(
    table: Path, names: Sequence[str], places: Sequence[Path], options: ImportOptions
) -> list[Path | None]:
    """Return the file of every name; None for a missing one where the options skip its row."""
    paths = [
        next((place / name for place in places if (place / name).is_file()), None) for name in names
    ]
    absent = [name for name, path in zip(names, paths, strict=True) if path is None]
    if absent and (options.missing == REFUSE or len(absent) == len(names)):
        more = f" (and {len(absent) - 1:,} more)" if len(absent) > 1 else ""
        raise UserError(
            f"{table} names the frame {absent[0]}{more}, which is not in {places[0]}; add the "
            "files or remove their rows."
        )
    return paths


def _find_rest(folder: Path, listed: set[Path]) -> Path | None:
    """Return init_0.png, another *init*.png, or the image_0.png of newer recordings."""
    paths = [folder / "init_0.png", *sorted(folder.glob("*init*.png")), folder / "image_0.png"]
    return next((path for path in paths if path not in listed and path.is_file()), None)


def read_labels(
    table: Table,
    names: Sequence[str],
    rows: Sequence[int],
    options: ImportOptions,
    *,
    name: str = "",
    columns: Sequence[str] | None = None,
    others: Collection[str] = (),
) -> dict[str, Any]:
    """Return the fields of a recording that come from the labels of its table.

    Args:
        table: The table.
        names: Name of the frame of every row; each is a press of its own unless the options name
            columns.
        rows: Rows that become frames.
        options: Names of columns, and the meaning of the labels.
        name: Column that names the frames.
        columns: Columns that must be numbers; None: all columns that are mostly numbers.
        others: Columns that are no labels, such as channels.

    Raises:
        UserError: A column is missing, a cell is no number, or labels describe no scene that can
            be.
    """
    others = {*others, *table.signals}
    if options.labels != AUTO:
        columns = table.select(options.labels)
    elif columns is None:
        no_labels = {name, options.press, options.join, *others}
        may_be = (column for column in table.columns if column not in no_labels)
        columns = [column for column in may_be if table.numeric_share(column) >= _MOSTLY_NUMBERS]
    indenter = choose_indenter(options, columns)
    needed, empty = tip_columns(options, indenter)  # read even where cells are no numbers
    columns = tuple(dict.fromkeys([*columns, *(c for c in table.columns if c in needed)]))
    labels = {column: table.numbers(column, allow_empty=column in empty) for column in columns}
    roles = role_columns(options, indenter, labels, table.path)
    scenes = scenes_of(labels, roles, options, indenter, table.path)
    presses = read_presses(table, options) or names
    forces: Sequence[Forces | None] = [None] * len(names)
    if scenes is not None and "force" in roles:
        newtons = signed_column(labels, roles["force"])
        forces = normal_forces(scenes, newtons, options.surface_radius_mm)
    return {
        "names": tuple(names[row] for row in rows),
        "labels": {column: values[rows] for column, values in labels.items()},
        "scenes": tuple(None if scenes is None else scenes[row] for row in rows),
        "presses": tuple(presses[row] for row in rows),
        "forces": tuple(forces[row] for row in rows),
        "columns": {"name": name, **roles} if name else roles,
        "extra": {
            column: tuple(map(str, table.cells[column].iloc[list(rows)]))
            for column in table.columns
            if column not in {*columns, *others, name}
        },
        "dome_radius_mm": None if indenter == NONE else options.surface_radius_mm,
    }


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
    for path in (*paths, *([] if rest is None else [rest])):
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
