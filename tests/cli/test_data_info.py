"""`tactibench data info`: facts, histograms, pins, protocols, a sheet."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest


def frame(shift):
    image = np.zeros((80, 90), np.uint8)
    for k in range(25):
        cv2.circle(image, (12 + 15 * (k % 5) + shift, 12 + 13 * (k // 5)), 3, 255, -1)
    return image


@pytest.fixture
def bristol(tmp_path):
    folder = tmp_path / "bristol"
    (folder / "images").mkdir(parents=True)
    for i in range(9):
        cv2.imwrite(str(folder / "images" / f"image_{i}.png"), frame(i % 4))
    lines = "".join(f"image_{i}.png,0,{i / 4},0,0,0,{5 - i}\n" for i in range(1, 9))
    head = "sensor_image,pose_x,pose_y,pose_z,pose_Rx,pose_Ry,pose_Rz\n"
    (folder / "targets.csv").write_text(head + lines)
    return folder


def rows(path):
    found = {}
    for row in json.loads(path.read_text()):
        found.setdefault(row["metric"], {})[row["group"]] = row
    return found


def test_a_bristol_folder(cli, bristol, tmp_path):
    out, sheet = tmp_path / "info.json", tmp_path / "sheet.png"
    shown = cli("data", "info", bristol, "--json", out, "--sheet", sheet)[1]
    for text in (
        "bristol (targets.csv, sensor_image)",
        "8 of 80x90 gray, 8 presses",
        "image_0.png",
        "none, labels only",
        "25 found",
        "depth from pose_y",
    ):
        assert text in shown
    found = rows(out)
    assert found["least"]["pose_y"]["value"] == 0.25
    assert (found["most"]["pose_Rz"]["value"], found["most"]["pose_Rz"]["unit"]) == (4.0, "deg")
    assert sum(found["histogram"]["pose_y"]["value"]) == 8
    assert {name: row["value"] for name, row in found["served"].items()} == {
        "exp1": False,
        "exp2": False,
        "exp3": False,
        "fine": False,
        "stability": False,
        "surface": True,
        "surface-all": True,
        "transfer": True,
    }
    assert "only labels are known" in found["served"]["exp1"]["reason"]
    assert cv2.imread(str(sheet)) is not None
