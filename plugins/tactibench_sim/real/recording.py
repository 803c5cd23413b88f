"""Recorded plate presses: labels from targets.csv, pins found and followed in the frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench.markers import Tracker
from tactibench_sim.real.plate import Labels

Array = npt.NDArray[np.float64]

COLUMNS = {"depth": "pose_2", "tilt": "pose_6", "move": "move_1", "turn": "move_6"}
REST = "init_0.png"


@dataclass(frozen=True, eq=False)
class Presses:
    """N recorded presses.

    Attributes:
        names: Names of the frames.
        labels: Labels of the presses.
        rest: (P, 2) places of the pins at rest, px.
        moved: (N, P, 2) displacements of the pins, px; NaN for pins that were not seen.
        side: Side of the frames, px.
    """

    names: tuple[str, ...]
    labels: Labels
    rest: Array
    moved: Array
    side: int

    def __len__(self) -> int:
        return len(self.names)

    @property
    def complete(self) -> float:
        """Share of the frames in which every pin was matched."""
        return float(np.isfinite(self.moved).all(axis=(1, 2)).mean())

    def take(self, rows: npt.NDArray[np.intp]) -> Presses:
        """Return some of the presses."""
        names = tuple(self.names[row] for row in rows)
        return Presses(names, self.labels.take(rows), self.rest, self.moved[rows], self.side)


def read(folder: Path, least: int) -> Presses:
    """Return all presses of a recording.

    Args:
        folder: Folder of the recording.
        least: Least number of presses.

    Raises:
        UserError: targets.csv is missing, unreadable, lacks a column or holds a label that is no
            number; a frame or init_0.png is missing or of another size; the rest frame has no
            pins; or there are fewer than ``least`` presses.
    """
    import pandas as pd

    table = folder / "targets.csv"
    if not table.is_file():
        raise UserError(
            f"{table} is not there; name the folder of a recording that holds targets.csv and "
            "frames_bw, as the Tac-VGNN sets do (model_surface2d)."
        )
    try:
        rows = pd.read_csv(table)
    except (ValueError, UnicodeDecodeError) as error:
        raise UserError(f"{table} cannot be read as CSV ({type(error).__name__}).") from None
    needed = ["image_name", *COLUMNS.values()]
    if missing := [name for name in needed if name not in rows.columns]:
        raise UserError(
            f"{table} lacks the columns {', '.join(missing)}; needed: {', '.join(needed)}."
        )
    numbers = rows[list(COLUMNS.values())].apply(pd.to_numeric, errors="coerce")
    if not (sound := np.isfinite(numbers.to_numpy()).all(axis=1)).all():
        line = int(np.argmin(sound)) + 2
        raise UserError(f"line {line} of {table} holds a label that is no number; remove the line.")
    if len(rows) < least:
        raise UserError(f"{table} holds {len(rows)} presses; at least {least} are needed.")
    labels = Labels(*(numbers[c].to_numpy(float) for c in COLUMNS.values()))
    frames = folder / "frames_bw"
    first = _gray(frames / REST)
    tracker = Tracker(first)
    names = tuple(str(name) for name in rows["image_name"])
    moved = np.empty((len(names), *tracker.rest.shape))
    for k, name in enumerate(names):
        tracks = tracker.track(_gray(frames / name, first.shape)[None])
        moved[k] = np.where(tracks.seen[0, :, None], tracks.xy[0] - tracker.rest, np.nan)
    return Presses(names, labels, tracker.rest, moved, first.shape[1])


def _gray(path: Path, shape: tuple[int, ...] | None = None) -> npt.NDArray[np.uint8]:
    import cv2

    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
    if image is None:
        raise UserError(f"{path} is not there or no picture; add it or name another folder.")
    if shape is not None and image.shape != shape:
        raise UserError(f"{path} is {image.shape}, {REST} is {shape}; frames must be alike.")
    return np.asarray(image, dtype=np.uint8)
