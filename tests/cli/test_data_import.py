"""`tactibench data import` and `data fit`, called as a person does."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from tactibench.datasets import open_dataset

COUNT = 60


@pytest.fixture
def plates(tmp_path):
    """Frames in which a grid of pins spreads as a plate of known offset and pivot would."""
    folder = tmp_path / "plates"
    (folder / "frames_bw").mkdir(parents=True)
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.linspace(20, 108, 7), np.linspace(20, 108, 7)), -1).reshape(
        -1, 2
    )

    def draw(name, scale):
        image = np.zeros((129, 129), np.uint8)
        for x, y in (grid - 64) * scale + 64:
            cv2.circle(image, (round(x * 16), round(y * 16)), 48, 255, -1, cv2.LINE_AA, 4)
        assert cv2.imwrite(str(folder / "frames_bw" / name), image)

    draw("init_0.png", 1.0)
    lines = ["image_name,pose_2,pose_6"]
    for i in range(COUNT):
        depth, tilt = rng.uniform(1, 5), rng.uniform(-20, 20)
        draw(f"frame_{i}.png", 1 + 0.02 * depth**1.37)
        label = depth - 4 - 10 * (1 - np.cos(np.radians(tilt)))
        lines.append(f"frame_{i}.png,{float(label)!r},{float(tilt)!r}")
    (folder / "targets.csv").write_text("\n".join(lines))
    return folder


def test_fit_prints_the_command_that_imports_with_it(cli, plates, tmp_path):
    code, shown, _ = cli("data", "fit", plates, "--json", "fit.json")
    assert code == 0
    rows = {row["metric"]: row for row in json.loads((tmp_path / "fit.json").read_text())}
    assert rows["offset a"]["value"] == pytest.approx(4, abs=0.1)
    assert rows["pivot p"]["value"] == pytest.approx(10, abs=2.5)
    line = shown.strip().splitlines()[-1].replace("TARGET", str(tmp_path / "out"))
    assert line.startswith("tactibench data import ")
    assert cli(*line.split()[1:])[0] == 0
    dataset = open_dataset(tmp_path / "out")
    assert all(1 < s.scene.pose.depth < 5.2 for s in dataset.samples)


def test_import_says_what_it_made(cli, plates, tmp_path):
    (plates / "frames_bw" / "spare.png").write_bytes(b"")
    shown = cli("data", "import", plates, "out")[1]
    assert "60 frames of 129x129 gray, labels without contacts" in shown
    assert len(open_dataset(tmp_path / "out").samples) == COUNT
