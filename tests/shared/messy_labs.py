"""Presses as labs keep them: folders of frames, and of channels, with tables of their labels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tactibench.datasets import guess_mapping, open_recording, read_mapping, write_mapping

ROWS = 40
SIZE = 24


def press_image(x: float, y: float, depth: float, reach: float) -> np.ndarray:
    """A bright bump at the place of the press, the larger the deeper."""
    grid = np.arange(SIZE)
    at = [SIZE * (0.5 + 0.35 * v / reach) for v in (x, y)]
    apart = (grid[None] - at[0]) ** 2 + (grid[:, None] - at[1]) ** 2
    return np.asarray(20 + 50 * depth * np.exp(-apart / 40), dtype=np.uint8)


class Lab:
    """Random presses with their frames, and tables of them."""

    def __init__(self, folder: Path, rows: int = ROWS) -> None:
        rng = np.random.default_rng(4)
        self.folder = folder
        self.x, self.y = rng.uniform(-6, 6, (2, rows)).round(3)
        self.depth = rng.uniform(0.2, 3, rows).round(3)
        self.rng, self.rows = rng, rows
        folder.mkdir(parents=True)
        self.draw(folder)

    def draw(self, folder: Path, suffix: str = ".png", names: Sequence[int] | None = None) -> None:
        folder.mkdir(exist_ok=True)
        for row in range(self.rows) if names is None else names:
            image = press_image(self.x[row], self.y[row], self.depth[row], 6)
            assert cv2.imwrite(str(folder / f"f{row}{suffix}"), image)

    def table(self, columns: dict[str, Any], separator: str = ",", name: str = "log.csv") -> Path:
        columns = {"file": [f"f{row}.png" for row in range(self.rows)]} | columns
        cells = [[str(cell) for cell in values] for values in columns.values()]
        lines = [separator.join(row) for row in [[*columns], *zip(*cells, strict=True)]]
        (self.folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
        return self.folder


def hovering(folder: Path, share: float = 0.5) -> Lab:
    """Presses of which some hover above the sensor: a lab whose depth there is below 0."""
    lab = Lab(folder, 120)
    above = lab.rng.uniform(size=lab.rows) < share
    lab.depth = np.where(above, -lab.rng.uniform(0.5, 6, lab.rows), lab.depth).round(3)
    for row in range(lab.rows):
        image = press_image(lab.x[row], lab.y[row], max(lab.depth[row], 0), 6)
        assert cv2.imwrite(str(folder / f"f{row}.png"), image)
    return lab


def imported(lab: Lab, columns: dict[str, Any], tmp_path: Path) -> tuple[Any, list[Any]]:
    """Return the guess for a table, and the poses that it gives."""
    guess = guess_mapping(lab.table(columns))
    write_mapping(tmp_path / "guess.toml", guess)
    recording = open_recording(lab.folder, read_mapping(tmp_path / "guess.toml"))
    return guess, [scene.pose for scene in recording.scenes if scene is not None]


class Skin:
    """Random presses on sixteen taxels, and files of them."""

    def __init__(self, folder: Path, rows: int = 120) -> None:
        rng = np.random.default_rng(1)
        self.folder, self.rows, self.rng = folder, rows, rng
        self.x, self.y = rng.uniform(-20, 20, (2, rows)).round(3)
        self.depth = rng.uniform(0.2, 3, rows).round(3)
        at = np.array([(a, b) for a in (-15, -5, 5, 15) for b in (-15, -5, 5, 15)])
        apart = (self.x[:, None] - at[:, 0]) ** 2 + (self.y[:, None] - at[:, 1]) ** 2
        self.taxels = self.depth[:, None] * np.exp(-apart / 400) + rng.normal(0, 0.01, apart.shape)
        folder.mkdir(parents=True)

    def write(self, name: str, columns: Sequence[Any], header: str = "") -> Path:
        rows = [",".join(map(str, row)) for row in np.column_stack(columns)]
        (self.folder / name).write_text("\n".join([header] * bool(header) + rows) + "\n")
        return self.folder
