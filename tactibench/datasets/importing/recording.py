"""A recording, whatever its format: frames on the disk with their labels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Scene
from tactibench.datasets import Dataset
from tactibench.png import ImageKind, decode_png, read_file

FloatArray = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Recording:
    """N frames with what is known of them; every file was read once and is sound.

    format: "bristol", "csv", "huggingface" or "v1". generation: which variant of it, in words.
    folder: what was opened. table: the file of the labels. names: of the frames, unique, in the
    table's order. paths: their files, frames: the folder they lie in. kind: what every frame is.
    rest: file of the undeformed frame. labels: column -> (N,) mm or deg; NaN where a frame of a v1
    data set has no such label. scenes: what was pressed, None where only labels are known.
    presses: frames of one press share it. sha256: over table and frames. columns: role -> column.
    extra: other columns -> (N,) texts. parts: name of a split -> rows. about: what files beside the
    table say. notes: sentences about what was left out or is missing. dataset, rows: of a v1 data
    set, and the numbers of its samples.
    """

    format: str
    generation: str
    folder: Path
    table: Path
    names: tuple[str, ...]
    paths: tuple[Path, ...]
    frames: Path
    kind: ImageKind
    rest: Path | None
    labels: Mapping[str, FloatArray]
    scenes: tuple[Scene | None, ...]
    presses: tuple[str, ...]
    sha256: str
    columns: Mapping[str, str] = field(default_factory=dict)
    extra: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    parts: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)
    dome_radius_mm: float | None = None
    notes: tuple[str, ...] = ()
    dataset: Dataset | None = None
    rows: tuple[int, ...] = ()

    @property
    def channels(self) -> Literal[1, 3]:
        """1 gray, 3 RGB."""
        return 3 if self.kind.colour else 1

    def __len__(self) -> int:
        return len(self.names)

    def image(self, row: int) -> Image:
        """(H, W) or RGB (H, W, 3) uint8. Raises UserError when the file is not what it was."""
        if self.dataset is not None:
            return self.dataset.image(self.dataset.samples[self.rows[row]])
        return self._decoded(self.paths[row])

    def rest_image(self) -> Image | None:
        """The undeformed frame; None where there is none. Raises UserError."""
        if self.dataset is not None:
            return self.dataset.rest
        return None if self.rest is None else self._decoded(self.rest)

    def _decoded(self, path: Path) -> Image:
        return decode_png(path, read_file(path), self.kind)
