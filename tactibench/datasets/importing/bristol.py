"""Recordings in the convention of the Bristol tactile stack: targets.csv and a folder of frames.

Generations differ in the column that names the frames (image_name; sensor_image), in the labels
(pose_1 ... pose_6; pose_x ... pose_Rz, with shear_* and object_*), in the folder of the frames and
in the files that say how they were taken (meta.json; *_params.json). Names may have backslashes.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from tactibench.datasets.importing.assemble import Source
from tactibench.datasets.importing.options import AUTO, FRAME_FOLDERS, ImportOptions
from tactibench.datasets.importing.table import read_table
from tactibench.errors import UserError
from tactibench.png import read_file

TARGETS = ("targets.csv", "targets_images.csv")
NAME_COLUMNS = ("image_name", "sensor_image")
ABOUT = ("meta.json", "*_params.json")

_LABEL = re.compile(r"(pose|move|shear|object)_([1-6]|[xyz]|R[xyz])")


def targets_of(folder: Path) -> Path | None:
    """The table of a folder, if it is one of these recordings."""
    return next((folder / name for name in TARGETS if (folder / name).is_file()), None)


def read_bristol(folder: Path, options: ImportOptions) -> Source:
    """Read the table of a folder. Raises UserError."""
    path = folder / options.table if options.table else targets_of(folder)
    if path is None or not path.is_file():
        raise UserError(f"{folder} holds no {options.table or TARGETS[0]}; name another folder.")
    data = read_file(path)
    table = read_table(path, data)
    name = table.column(options.column) if options.column else table.column(*NAME_COLUMNS)
    frames = _frames_folder(folder, options.frames)
    labels = tuple(column for column in table.columns if _LABEL.fullmatch(column))
    lettered = any(column.partition("_")[2] in ("x", "Rx") for column in labels)
    poses = "pose_x..pose_Rz" if lettered else "pose_1..pose_6"
    return Source(
        "bristol",
        f"{name}, {poses}, {frames.name}",
        folder,
        table,
        data,
        name,
        (frames, folder),  # older tables name frames from the folder above theirs
        labels,
        frames,
        about={file.name: _about(file) for file in _about_files(folder)},
    )


def _frames_folder(folder: Path, wanted: str) -> Path:
    names = FRAME_FOLDERS if wanted == AUTO else (wanted,)
    for name in names:
        if (folder / name).is_dir():
            return folder / name
    raise UserError(f"{folder} holds no folder of frames; looked for {', '.join(names)}.")


def _about_files(folder: Path) -> list[Path]:
    return sorted(file for pattern in ABOUT for file in folder.glob(pattern) if file.is_file())


def _about(path: Path) -> Any:
    def refuse(word: str) -> None:
        raise ValueError(f"it holds {word}, which JSON does not know")

    try:
        return json.loads(read_file(path).decode("utf-8-sig"), parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise UserError(
            f"{path} cannot be read as JSON: {str(error).rstrip('.')}; mend or remove it."
        ) from None
