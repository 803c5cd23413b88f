"""Folders of frames that cannot be used."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

HEADER = "image_name,pose_1,pose_2,pose_3,pose_4,pose_5,pose_6"
SURFACE = ("run", "surface", "--model", "mean", "--data", "plates")


@pytest.fixture
def plates(tmp_path: Path) -> Path:
    """Thirty plate presses."""
    folder = tmp_path / "plates"
    (folder / "frames_bw").mkdir(parents=True)
    rows = [HEADER]
    for i in range(30):
        image = np.random.default_rng(i).integers(0, 256, (12, 10), dtype=np.uint8)
        assert cv2.imwrite(str(folder / "frames_bw" / f"frame_{i}_0.png"), image)
        rows.append(f"frame_{i}_0.png,0,{-i / 10},0,0,0,{i - 15}")
    (folder / "targets.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder


def without_a_frame(folder: Path) -> None:
    (folder / "frames_bw" / "frame_3_0.png").unlink()


def with_half_a_frame(folder: Path) -> None:
    file = folder / "frames_bw" / "frame_3_0.png"
    file.write_bytes(file.read_bytes()[:-20])


def with_a_label_that_is_no_number(folder: Path) -> None:
    file = folder / "targets.csv"
    file.write_text(file.read_text(encoding="utf-8").replace("-0.3,", "deep,"), encoding="utf-8")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (without_a_frame, ["targets.csv", "frame_3_0.png", "not in"]),
        (with_half_a_frame, ["frame_3_0.png", "cut short"]),
        (with_a_label_that_is_no_number, ["targets.csv", "pose_2", "deep"]),
    ],
)
def test_a_run_on_a_folder_that_is_not_whole_ends_with_its_sentence(
    refused: Any, plates: Path, spoil: Callable[[Path], None], words: list[str]
) -> None:
    spoil(plates)
    sentence = refused(*SURFACE)
    for word in words:
        assert word in sentence


def test_a_file_instead_of_a_folder(refused: Any, plates: Path) -> None:
    sentence = refused("run", "surface", "--model", "mean", "--data", plates / "targets.csv")
    assert "targets.csv" in sentence
    assert "folder" in sentence


def test_plates_for_a_protocol_of_tips(refused: Any, plates: Path) -> None:
    sentence = refused("run", "exp1", "--model", "mean", "--data", "plates")
    for word in ("30 presses by plate", "'exp1'", "spherical tips", "'surface'"):
        assert word in sentence


def test_a_whole_folder_is_planned(cli: Any, plates: Path) -> None:
    code, out, err = cli(*SURFACE, "--dry-run")
    assert (code, err) == (0, "")
    assert out.startswith("plan: ")
