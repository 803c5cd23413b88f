"""A CSV file that names frames, and labels beside the names."""

from __future__ import annotations

from pathlib import Path

from tactibench.datasets.readers.bristol import NAME_COLUMNS
from tactibench.datasets.readers.folder import FolderContent
from tactibench.datasets.readers.options import AUTO, FRAME_FOLDERS, ImportOptions
from tactibench.datasets.readers.table import read_table
from tactibench.errors import UserError
from tactibench.png import read_file

NAMES = ("file_name", "filename", *NAME_COLUMNS, "image", "frame", "file", "path", "name")
"""Columns that may name the frames, in order."""


def read_csv(folder: Path, options: ImportOptions) -> FolderContent:
    """Read the one table of a folder.

    Raises:
        UserError: There is no table or several, or it cannot be read.
    """
    path = _table_path(folder, options.table)
    data = read_file(path)
    table = read_table(path, data)
    name = table.column(options.column) if options.column else table.column(*NAMES)
    if options.frames != AUTO:
        frames = folder / options.frames
        if not frames.is_dir():
            raise UserError(f"{frames} is no folder; name that of the frames with --param frames.")
        searched: tuple[Path, ...] = (frames,)
    else:
        known = [path for path in (folder / f for f in FRAME_FOLDERS) if path.is_dir()]
        searched = (folder, *known)
        frames = known[0] if known else folder
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
    raise UserError(f"{folder} holds several CSV files ({names}); name one with --param table.")
