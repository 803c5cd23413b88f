"""`tactibench data info`: facts, histograms, pins, protocols, a sheet."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import Draft, Header, Writer


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


@pytest.fixture
def singles(tmp_path):
    folder = tmp_path / "singles"
    rng = np.random.default_rng(0)
    header = Header("tips", {"name": "tactip"}, (80, 90), dome_radius_mm=20.0, licence="CC0-1.0")
    with Writer(folder, header, fsync=False) as writer:
        writer.reference(frame(0))
        for i in range(20):
            x, y = rng.uniform(-6, 6, 2)
            scene = Scene(Indenter.single(), Pose(float(x), float(y), depth=0.25 * (i + 1)))
            writer.add(Draft(frame(i % 4), id=i, scene=scene, press=f"p{i // 2}"))
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
        "sensor_image, pose_x..pose_Rz, images",
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


def test_a_data_set_of_single_presses(cli, singles, tmp_path):
    shown = cli("data", "info", singles, "--json", "i.json")[1]
    for text in ("tips", "v1 (schema 1, closed)", "10 presses", "20 frames", "CC0-1.0"):
        assert text in shown
    served = rows(tmp_path / "i.json")["served"]
    assert [served[name]["value"] for name in ("exp1", "exp2", "surface")] == [True, False, False]
    assert "2 outside of it" in served["exp1"]["reason"] or "train" in served["exp1"]["reason"]
    assert "two tips" in served["exp2"]["reason"]


def test_no_line_is_cut_on_a_narrow_terminal(cli, bristol, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    assert "█" in cli("data", "info", bristol)[1]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["no"], "does not exist"),
        (["bristol", "--sheet", "sheet.jpg"], "no PNG file"),
        (["bristol", "--json", "no/info.json"], "is not there"),
        (["channels", "--sheet", "a.png"], "holds 15 channels and no images; leave --sheet out"),
    ],
)
def test_mistakes(refused, bristol, channels, arguments, says):
    assert says in refused("data", "info", *arguments)
