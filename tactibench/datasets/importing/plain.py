"""A CSV file that names frames, and labels beside the names."""

from __future__ import annotations

from pathlib import Path

from tactibench.datasets.importing.assemble import Source
from tactibench.datasets.importing.bristol import NAME_COLUMNS
from tactibench.datasets.importing.options import AUTO, FRAME_FOLDERS, ImportOptions
from tactibench.datasets.importing.table import read_table
from tactibench.errors import UserError
from tactibench.png import read_file

NAMES = ("file_name", "filename", *NAME_COLUMNS, "image", "frame", "file", "path", "name")


def read_plain(folder: Path, options: ImportOptions) -> Source:
    """Read the one table of a folder. Raises UserError."""
    path = _table(folder, options.table)
    data = read_file(path)
    table = read_table(path, data)
    name = table.column(options.column) if options.column else table.column(*NAMES)
    folders = tuple(folder / name for name in FRAME_FOLDERS)
    frames = folder / options.frames if options.frames != AUTO else None
    if frames is not None and not frames.is_dir():
        raise UserError(f"{frames} is no folder; name that of the frames with --param frames.")
    searched = (frames,) if frames else (folder, *(f for f in folders if f.is_dir()))
    return Source(
        "csv",
        f"{path.name}, {name}",
        folder,
        table,
        data,
        name,
        searched,
        None,
        frames or next((f for f in folders if f.is_dir()), folder),
    )


def _table(folder: Path, wanted: str) -> Path:
    found = [folder / wanted] if wanted else sorted(folder.glob("*.csv"))
    if len(found) == 1 and found[0].is_file():
        return found[0]
    if wanted or not found:
        raise UserError(f"{folder} holds no {wanted or 'CSV file'}; name another folder.")
    names = ", ".join(path.name for path in found)
    raise UserError(f"{folder} holds several CSV files ({names}); name one with --param table.")
