"""Small recordings of every generation, and a way to see that a mistake is one sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactibench import UserError

NUMBERED = "pose_1,pose_2,pose_3,pose_4,pose_5,pose_6"
LETTERED = "pose_x,pose_y,pose_z,pose_Rx,pose_Ry,pose_Rz"


def write_frames(folder: Path, names: str, count: int, rest: str = "") -> None:
    """Write frames whose names hold the place of a number, and the sensor at rest."""
    folder.mkdir(parents=True)
    files = [(names.format(i), i) for i in range(count)] + ([(rest, 99)] if rest else [])
    for name, seed in files:
        image = np.random.default_rng(seed).integers(0, 256, (12, 10), dtype=np.uint8)
        assert cv2.imwrite(str(folder / name), image)


def write_targets(folder: Path, header: str, line: str) -> None:
    """Write five rows: number i of the row, n = i + 1, depth label d mm, tilt t deg."""
    rows = [line.format(i=i, n=i + 1, d=-0.25 * (i + 1), t=3.5 * i - 4.0) for i in range(5)]
    (folder / "targets.csv").write_text("\n".join([header, *rows]))


@pytest.fixture
def first(tmp_path: Path) -> Path:
    """First generation: image_name, pose_1.., frames_bw, meta.json."""
    folder = tmp_path / "first"
    write_frames(folder / "frames_bw", "frame_{}_0.png", 5, rest="init_0.png")
    header, line = f"image_name,kind,{NUMBERED},move_1", "frame_{i}_0.png,obj,0,{d},0,0,0,{t},{i}"
    write_targets(folder, header, line)
    (folder / "meta.json").write_text('{"exposure": -7, "image_dir": "a\\\\frames_bw"}')
    return folder


@pytest.fixture
def second(tmp_path: Path) -> Path:
    """Second generation: sensor_image with backslashes from the folder above, images, no rest."""
    folder = tmp_path / "second"
    write_frames(folder / "images", "image_{}.png", 6)
    (folder / "images" / "image_0.png").unlink()
    write_targets(folder, f"sensor_image,{LETTERED}", r"images\image_{n}.png,0,{d},0,0,0,{t}")
    return folder


@pytest.fixture
def third(tmp_path: Path) -> Path:
    """Third generation: sensor_images, shear and object labels, image_0 at rest, *_params.json."""
    folder = tmp_path / "third"
    write_frames(folder / "sensor_images", "image_{}.png", 6)
    header = f"sensor_image,object_label,{LETTERED},shear_x,object_x"
    write_targets(folder, header, "image_{n}.png,edge,0,{d},0,0,0,{t},{i},7")
    (folder / "collect_params.json").write_text('{"sort": true}')
    (folder / "sensor_image_params.json").write_text('{"bbox": [1, 2, 3, 4]}')
    return folder


@pytest.fixture
def refused() -> Callable[..., str]:
    """Check that a call is refused in one sentence with these words, and return it."""

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
