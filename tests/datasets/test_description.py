"""Pin counts, units and the choice of frames for a contact sheet."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tactibench.cli.data import draw_sheet
from tactibench.datasets import open_recording, pin_counts, spread_rows, unit_of


def test_units_by_name():
    units = {"pose_1": "mm", "shear_Rz": "deg", "x_mm": "mm", "pose.tilt": "deg", "force": ""}
    assert {name: unit_of(name) for name in units} == units


def test_rows_of_a_sheet_follow_the_label_that_says_most() -> None:
    rng = np.random.default_rng(0)
    values = {"move_1": rng.random(90), "b": np.ones(90), "pose_2": rng.random(90)}
    values["c"] = np.full(90, np.nan)
    labels, rows = spread_rows(values, 90, 48)
    assert labels == ["pose_2", "move_1"]
    assert len(rows) == len(set(rows)) == 48
    assert (np.diff(values["pose_2"][rows]) >= 0).all()
    assert rows[0] == values["pose_2"].argmin()
    assert rows[-1] == values["pose_2"].argmax()
    assert spread_rows({}, 3, 48) == ([], [0, 1, 2])


@pytest.fixture
def dots(tmp_path):
    """Frames with 25 pins, the last one without any."""
    folder = tmp_path / "dots"
    (folder / "images").mkdir(parents=True)
    for i in range(5):
        image = np.zeros((80, 90), np.uint8)
        for k in range(25 if i < 4 else 0):
            centre = (12 + 15 * (k % 5) + i, 12 + 13 * (k // 5))
            cv2.circle(image, centre, 3, 255, -1)
        cv2.imwrite(str(folder / "images" / ("init_0.png" if i == 0 else f"f{i}.png")), image)
    lines = "".join(f"f{i}.png,{i},{-i},0.5\n" for i in range(1, 5))
    (folder / "targets.csv").write_text("image_name,pose_2,pose_6,pose_1\n" + lines)
    return folder


def test_pins_are_counted(dots):
    assert pin_counts(open_recording(dots)) == ([25, 25, 25, 0], 25)
    (dots / "images" / "init_0.png").unlink()
    assert pin_counts(open_recording(dots), 2) == ([25, 0], None)


def test_the_sheet_is_a_picture(dots, tmp_path):
    draw_sheet(tmp_path / "sheet.png", open_recording(dots))
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape[0] > 1000
    assert sheet.std() > 5
