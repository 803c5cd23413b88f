"""Small recordings in the Bristol convention."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from tac_vgnn import tac_vgnn_folder

from tactibench import SensorContext
from tactibench_recorded.sensor import RecordedSensor

HEADER = "image_name,pose_1,pose_2,pose_3,pose_4,pose_5,pose_6"


def frame(index: int, height: int = 12, width: int = 10) -> np.ndarray:
    """A frame that only this index has."""
    return np.random.default_rng(index).integers(0, 256, (height, width), dtype=np.uint8)


def write_png(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def write_targets(folder: Path, rows: list[str], header: str = HEADER) -> None:
    (folder / "targets.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")


def poses(count: int) -> list[tuple[float, float]]:
    """(depth label mm, tilt deg) of each row."""
    return [(-0.25 * (i + 1), 3.5 * i - 4.0) for i in range(count)]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Five frames and a rest frame, in order frame_0_0.png ... frame_4_0.png."""
    folder = tmp_path / "plates"
    for i in range(5):
        write_png(folder / "frames_bw" / f"frame_{i}_0.png", frame(i))
    write_png(folder / "frames_bw" / "init_0.png", frame(99))
    write_targets(folder, [f"frame_{i}_0.png,0,{d},0,0,0,{t}" for i, (d, t) in enumerate(poses(5))])
    return folder


@pytest.fixture
def open_recording() -> Callable[..., RecordedSensor]:
    def opened(folder: Path | None, **parameters: Any) -> RecordedSensor:
        return RecordedSensor(SensorContext(np.random.SeedSequence(0), folder), **parameters)

    return opened


@pytest.fixture
def tac_vgnn() -> Path:
    """The public Tac-VGNN recordings, which live outside the project."""
    return tac_vgnn_folder()
