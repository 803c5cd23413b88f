"""Small recordings of every generation, and a way to see that a mistake is one sentence."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactibench import UserError

NUMBERED = "pose_1,pose_2,pose_3,pose_4,pose_5,pose_6"
LETTERED = "pose_x,pose_y,pose_z,pose_Rx,pose_Ry,pose_Rz"


def picture(index: int, height: int = 12, width: int = 10) -> np.ndarray:
    return np.random.default_rng(index).integers(0, 256, (height, width), dtype=np.uint8)


def put(path: Path, index: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), picture(index))


def rows(count: int) -> list[tuple[float, float]]:
    """(depth label mm, tilt deg) of each row."""
    return [(-0.25 * (i + 1), 3.5 * i - 4.0) for i in range(count)]


@pytest.fixture
def first(tmp_path: Path) -> Path:
    """First generation: image_name, pose_1.., frames_bw, meta.json."""
    folder = tmp_path / "first"
    for i in range(5):
        put(folder / "frames_bw" / f"frame_{i}_0.png", i)
    put(folder / "frames_bw" / "init_0.png", 99)
    lines = [f"frame_{i}_0.png,obj,0,{d},0,0,0,{t},{i}" for i, (d, t) in enumerate(rows(5))]
    (folder / "targets.csv").write_text(f"image_name,kind,{NUMBERED},move_1\n" + "\n".join(lines))
    (folder / "meta.json").write_text('{"exposure": -7, "image_dir": "a\\\\frames_bw"}')
    return folder


@pytest.fixture
def second(tmp_path: Path) -> Path:
    """Second generation: sensor_image with backslashes from the folder above, images, no rest."""
    folder = tmp_path / "second"
    for i in range(5):
        put(folder / "images" / f"image_{i + 1}.png", i)
    lines = [f"images\\image_{i + 1}.png,0,{d},0,0,0,{t}" for i, (d, t) in enumerate(rows(5))]
    (folder / "targets.csv").write_text(f"sensor_image,{LETTERED}\n" + "\n".join(lines))
    return folder


@pytest.fixture
def third(tmp_path: Path) -> Path:
    """Third generation: sensor_images, shear and object labels, image_0 at rest, *_params.json."""
    folder = tmp_path / "third"
    for i in range(5):
        put(folder / "sensor_images" / f"image_{i + 1}.png", i)
    put(folder / "sensor_images" / "image_0.png", 99)
    lines = [f"image_{i + 1}.png,edge,0,{d},0,0,0,{t},{i},7" for i, (d, t) in enumerate(rows(5))]
    header = f"sensor_image,object_label,{LETTERED},shear_x,object_x\n"
    (folder / "targets.csv").write_text(header + "\n".join(lines))
    (folder / "collect_params.json").write_text('{"sort": true}')
    (folder / "sensor_image_params.json").write_text('{"bbox": [1, 2, 3, 4]}')
    return folder


@pytest.fixture
def refused() -> Callable[..., str]:
    """Call, words -> the sentence of the UserError, which holds all words."""

    def check(call: Callable[[], object], *words: str) -> str:
        with pytest.raises(UserError) as caught:
            call()
        text = str(caught.value)
        assert text[-1] in ".?"
        assert "\n" not in text
        for word in words:
            assert word in text
        return text

    return check


@pytest.fixture
def tac_vgnn() -> Path:
    """The public Tac-VGNN recordings, which live outside the project."""
    default = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "tac-vgnn"
    folder = Path(os.environ.get("TACTIBENCH_TACVGNN", default))
    if not folder.is_dir():
        pytest.skip(f"the Tac-VGNN frames are not at {folder}; set TACTIBENCH_TACVGNN")
    return folder
