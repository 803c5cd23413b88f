"""Mistakes in a recorded folder are one sentence, when the sensor opens and when frames are read.

What is wrong with tables and frames is tested with their readers (tests/datasets/readers).
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tactibench import UserError


def test_no_data_and_no_table(open_recording, recording):
    with pytest.raises(UserError, match="--data"):
        open_recording(None)
    (recording / "targets.csv").unlink()
    for folder in (recording, recording.parent):
        with pytest.raises(UserError, match=r"or other table"):
            open_recording(folder)


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
