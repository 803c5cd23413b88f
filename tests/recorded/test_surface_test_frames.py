"""The published test frames that protocol surface tests on."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

FILE = Path(__file__).resolve().parents[2] / "protocols" / "surface_test_frames.txt"
LINES = FILE.read_text(encoding="utf-8").splitlines()
NAMES = [line for line in LINES if not line.startswith("#")]


def test_the_list_has_1210_different_frames():
    assert len(NAMES) == len(set(NAMES)) == 1210
    assert all(re.fullmatch(r"frame_\d+_0\.png", name) for name in NAMES)


def test_the_names_carry_the_released_targets(tac_vgnn, open_recording):
    """Name by name, the labels of the recording are the targets released with the predictions."""
    with (tac_vgnn / "published_prediction.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    released = np.array(
        [
            [float(r[f"target_{k}"].removeprefix("tensor(").rstrip(")")) for k in (1, 2)]
            for r in rows
        ]
    )
    scenes = open_recording(tac_vgnn / "331", depth_offset_mm=0.0).scenes()
    poses = [scenes[name].pose for name in NAMES]
    labels = np.array([[pose.depth, pose.tilt] for pose in poses])
    assert np.abs(labels - released).max() < 1e-4
