"""Mistakes in a recorded folder are one sentence, when the sensor opens and when frames are read.

What is wrong with tables and frames is tested with their readers (tests/datasets/readers).
"""

from __future__ import annotations

import zlib

import cv2
import numpy as np
import pytest
from png_bytes import png

from tactibench import UserError


def test_no_data_and_no_table(open_recording, recording):
    with pytest.raises(UserError, match="--data"):
        open_recording(None)
    (recording / "targets.csv").unlink()
    for folder in (recording, recording.parent):
        with pytest.raises(UserError, match=r"no targets\.csv"):
            open_recording(folder)


@pytest.mark.parametrize("column", ["image_name", "pose_2", "pose_6"])
def test_a_missing_column(open_recording, recording, column):
    table = recording / "targets.csv"
    table.write_text(table.read_text().replace(column, "other"))
    with pytest.raises(UserError, match=rf"targets\.csv.*{column}.*its columns are"):
        open_recording(recording)


def test_the_png_writer_of_these_tests_is_right(open_recording, recording):
    rows = np.hstack([np.zeros((12, 1), np.uint8), np.full((12, 10), 7, np.uint8)])
    data = png(10, 12, zlib.compress(rows.tobytes()))
    (recording / "frames_bw" / "frame_0_0.png").write_bytes(data)
    sensor = open_recording(recording)
    assert (sensor.press(next(iter(sensor.scenes().values()))).image == 7).all()


@pytest.mark.parametrize(
    ("size", "pixels"),
    [((10, 12), b"junk"), ((10, 12), zlib.compress(b"few")), ((90_000, 90_000), b"")],
)
def test_frames_whose_pixels_cannot_be_decoded(open_recording, recording, size, pixels):
    for path in (recording / "frames_bw").iterdir():
        path.write_bytes(png(*size, pixels))
    sensor = open_recording(recording)
    with pytest.raises(UserError, match=r"init_0\.png cannot be decoded"):
        sensor.rest()
    with pytest.raises(UserError, match=r"frame_0_0\.png cannot be decoded"):
        sensor.press(next(iter(sensor.scenes().values())))


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda path: path.write_bytes(b""), "cannot be decoded"),
        (lambda path: path.write_bytes(b"no picture"), "cannot be decoded"),
        (lambda path: path.unlink(), "cannot be read"),
        (lambda path: cv2.imwrite(str(path), np.zeros((4, 5), np.uint8)), "its size to 4x5"),
    ],
)
def test_a_frame_that_breaks_after_opening(open_recording, recording, damage, says):
    sensor = open_recording(recording)
    damage(recording / "frames_bw" / "frame_2_0.png")
    scenes = list(sensor.scenes().values())
    with pytest.raises(UserError, match=rf"frame_2_0\.png .*{says}"):
        list(sensor.press_many(scenes))
    assert sensor.press(scenes[3]).timestamp == 3
