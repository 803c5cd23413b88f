"""Where things are in a recorded folder: targets.csv and the frames beside it.

The convention is the one of the Bristol tactile stack: `targets.csv` and one folder of PNG frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tactibench import UserError

TARGETS = "targets.csv"
FRAME_FOLDERS = ("frames_bw", "images", "sensor_images", "processed_images")


@dataclass(frozen=True)
class Layout:
    """folder: holds targets.csv. frames: holds the PNG files that targets.csv names."""

    folder: Path
    frames: Path

    @property
    def targets(self) -> Path:
        return self.folder / TARGETS


def find_layout(data: Path | None, frames: str = "auto") -> Layout:
    """Look for a recording in ``data`` itself and one level down.

    Raises UserError when there is none, when there are several, or when it has no frames folder.
    """
    if data is None:
        raise UserError(
            f"sensor 'recorded' needs --data FOLDER, a folder that holds {TARGETS} and its frames."
        )
    if not data.exists():
        raise UserError(f"--data {data} does not exist; give a folder that holds {TARGETS}.")
    if not data.is_dir():
        raise UserError(f"--data {data} is a file; give the folder that holds {TARGETS}.")
    folder = _folder_with_targets(data)
    return Layout(folder, _frames_folder(folder, frames))


def _folder_with_targets(data: Path) -> Path:
    if (data / TARGETS).is_file():
        return data
    try:
        found = sorted(child for child in data.iterdir() if (child / TARGETS).is_file())
    except OSError as error:
        raise UserError(f"--data {data} cannot be listed: {error.strerror}.") from None
    if not found:
        raise UserError(f"--data {data} holds no {TARGETS}, nor does any folder directly in it.")
    if len(found) > 1:
        names = ", ".join(child.name for child in found)
        raise UserError(f"--data {data} holds several recordings ({names}); give one of them.")
    return found[0]


def _frames_folder(folder: Path, wanted: str) -> Path:
    names = FRAME_FOLDERS if wanted == "auto" else (wanted,)
    for name in names:
        if (folder / name).is_dir():
            return folder / name
    raise UserError(
        f"{folder} holds {TARGETS} but no folder of frames; looked for {', '.join(names)}."
    )
