"""The format of a folder, and its reader: the format's own, or that of plain CSV files."""

from __future__ import annotations

from pathlib import Path

from tactibench.datasets.readers.bristol import NAME_COLUMNS, TARGETS, find_targets, read_bristol
from tactibench.datasets.readers.folder import FolderContent, read_recording
from tactibench.datasets.readers.huggingface import metadata_files, read_huggingface
from tactibench.datasets.readers.options import AUTO, FRAME_FOLDERS, ImportOptions
from tactibench.datasets.readers.recording import Recording, read_dataset
from tactibench.datasets.readers.table import read_table
from tactibench.datasets.readers.vectors import read_vectors
from tactibench.datasets.schema import is_dataset
from tactibench.errors import UserError, did_you_mean
from tactibench.png import read_file

NAMES = ("file_name", "filename", *NAME_COLUMNS, "image", "frame", "file", "path", "name")
"""Columns of a CSV file that may name the frames, in order."""

BRISTOL, HUGGINGFACE, CSV, V1 = "bristol", "huggingface", "csv", "v1"


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
    if options.frames != AUTO:
        frames = folder / options.frames
        if not frames.is_dir():
            raise UserError(f"{frames} is no folder; name that of the frames with --param frames.")
        searched: tuple[Path, ...] = (frames,)
    else:
        below = sorted(path for path in folder.iterdir() if path.is_dir())
        usual = [folder / name for name in FRAME_FOLDERS if folder / name in below]
        searched = (folder, *usual, *(path for path in below if path not in usual))
        first = table.cells[name][0].strip().replace("\\", "/")
        frames = next((place for place in searched if first and (place / first).is_file()), folder)
    return FolderContent(
        format="csv",
        generation=f"{path.name}, {name}",
        folder=folder,
        table=table,
        data=data,
        name_column=name,
        frame_folders=searched,
        label_columns=None,
        rest_folder=frames,
    )


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


_READERS = {BRISTOL: read_bristol, HUGGINGFACE: read_huggingface, CSV: read_csv}
FORMATS = tuple(_READERS)
"""Formats that can be imported."""


def find_format(folder: Path) -> str:
    """Return the format of a folder: "v1" or one of FORMATS.

    Raises:
        UserError: The folder has none of these formats.
    """
    _check_folder(folder)
    if is_dataset(folder):
        return V1
    if (targets := find_targets(folder)) is not None:
        columns = read_table(targets, read_file(targets)).columns
        return BRISTOL if set(NAME_COLUMNS) & set(columns) else CSV
    if _inner_recordings(folder):
        return BRISTOL
    if metadata_files(folder):
        return HUGGINGFACE
    if any(folder.glob("*.csv")):
        return CSV
    raise UserError(
        f"{folder} holds no {TARGETS[0]}, nor does any folder directly in it, and neither a "
        "dataset.json, a metadata.jsonl nor another CSV file; name a folder of recorded frames."
    )


def open_recording(
    folder: Path,
    options: ImportOptions | None = None,
    format: str | None = None,  # noqa: A002
) -> Recording:
    """Read the labels of a folder and check all its files.

    Args:
        folder: A recording of any format, or a data set.
        options: Names of files and columns, and the meaning of the labels; a data set needs none.
        format: One of FORMATS or "v1"; None: it is found from the files.

    Raises:
        UserError: Something is missing or damaged; the sentence names file and row.
    """
    options = options or ImportOptions()
    if options.channels:
        _check_folder(folder)
        return read_vectors(folder, options)
    format = format or find_format(folder)  # noqa: A001
    _check_folder(folder)
    if format == V1:
        return read_dataset(folder)
    if format not in _READERS:
        raise UserError(f"there is no format {format!r}; {did_you_mean(format, FORMATS)}")
    if format == BRISTOL and not (options.table or find_targets(folder)):
        folder = _only_recording(folder)
    return read_recording(_READERS[format](folder, options), options)


def _check_folder(folder: Path) -> None:
    if not folder.exists():
        raise UserError(f"{folder} does not exist; give a folder of recorded frames.")
    if not folder.is_dir():
        raise UserError(f"{folder} is a file; give the folder that holds it.")
    try:
        next(folder.iterdir(), None)
    except OSError as error:
        raise UserError(f"{folder} cannot be listed: {error.strerror}.") from None


def _inner_recordings(folder: Path) -> list[Path]:
    """Return the Bristol folders directly in a folder."""
    return sorted(child for child in folder.iterdir() if child.is_dir() and find_targets(child))


def _only_recording(folder: Path) -> Path:
    recordings = _inner_recordings(folder)
    if not recordings:
        raise UserError(f"{folder} holds no {TARGETS[0]}, nor does any folder directly in it.")
    if len(recordings) > 1:
        names = ", ".join(child.name for child in recordings)
        raise UserError(f"{folder} holds several recordings ({names}); give one of them.")
    return recordings[0]
