"""Histograms, pin counts and the choice of frames for a contact sheet."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tactibench.cli.data_info import draw_sheet

from tactibench.datasets import (
    BINS,
    changing_labels,
    describe_poses,
    open_recording,
    spread_rows,
    summarize_labels,
    summarize_pins,
    unit_of,
)


def test_a_histogram_counts_every_known_frame():
    column = np.r_[np.linspace(0, 1, 160, endpoint=False), np.nan]
    (label,) = summarize_labels({"pose_2": column, "none": np.full(161, np.nan)})
    assert label.counts == (10,) * 15 + (10,)
    assert (label.unit, label.bars) == ("mm", "█" * BINS)
    assert not label.constant


def test_bars_show_an_empty_bin_and_a_rare_one():
    (label,) = summarize_labels({"x": np.r_[np.zeros(1000), 1.0]})
    assert label.bars == "█" + " " * (BINS - 2) + "▁"
    (same,) = summarize_labels({"x": np.full(5, 3.0)})
    assert same.constant


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("pose_1", "mm"),
        ("pose_6", "deg"),
        ("shear_Rz", "deg"),
        ("pose_z", "mm"),
        ("x_mm", "mm"),
        ("pose.tilt", "deg"),
        ("pose.depth", "mm"),
        ("force", ""),
        ("yaw_deg", "deg"),
    ],
)
def test_units_by_name(name, unit):
    assert unit_of(name) == unit


def test_labels_that_vary_and_are_complete():
    values = {"a": np.arange(3.0), "b": np.ones(3), "c": np.array([1, np.nan, 2])}
    assert list(changing_labels(values)) == ["a"]
    many = {name: np.arange(3.0) for name in ("move_1", "pose_6", "other", "pose_2")}
    assert list(changing_labels(many)) == ["pose_2", "pose_6", "move_1"]


@given(st.integers(1, 60), st.integers(0, 3), st.integers(1, 48))
def test_rows_of_a_sheet_are_distinct_and_as_many_as_there_are(frames, labels, count):
    rng = np.random.default_rng(frames)
    columns = [rng.integers(0, 4, frames).astype(float) for _ in range(labels)]
    rows = spread_rows(columns, frames, count, 8)
    assert len(rows) == len(set(rows)) == min(frames, count)
    assert all(0 <= row < frames for row in rows)


def test_a_sheet_reaches_the_corners_and_reads_in_order():
    grid = np.array([(a, b) for a in range(20) for b in range(20)], dtype=float)
    rows = spread_rows([grid[:, 0], grid[:, 1]], 400, 48, 8)
    chosen = grid[rows]
    for corner in ((0, 0), (0, 19), (19, 0), (19, 19)):
        assert (chosen == corner).all(axis=1).any()
    for k in range(0, 48, 8):
        assert (np.diff(chosen[k : k + 8, 1]) >= 0).all()
    assert chosen[:8, 0].max() <= chosen[-8:, 0].min()


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


def test_pins_are_counted_and_followed(dots):
    pins = summarize_pins(open_recording(dots))
    assert pins.counts == (25, 25, 25, 0)
    assert (pins.frames, pins.rest, pins.visible_share) == (4, 25, 0.75)
    (dots / "images" / "init_0.png").unlink()
    without = summarize_pins(open_recording(dots), 2)
    assert (without.counts, without.rest, without.visible_share) == ((25, 0), None, None)


def test_the_sheet_is_a_picture(dots, tmp_path):
    draw_sheet(tmp_path / "sheet.png", open_recording(dots))
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape[0] > 1000
    assert sheet.std() > 5


@pytest.mark.parametrize(
    ("changing", "words"),
    [
        (("pose_2", "pose_6"), "a plate that is tilted, or an edge"),
        (("pose_y", "pose_Rz"), "a plate that is tilted, or an edge"),
        (("pose_1", "pose_3", "pose_6"), "an edge or another object"),
        (("pose_x", "pose_y", "pose_z"), "a tip or an object at several places"),
        (("pose_3", "move_1"), "at one place, no tilted plate; the skin is dragged (move_1)"),
    ],
)
def test_pose_labels_say_what_they_look_like(changing, words):
    labels = {f"pose_{k}": np.zeros(3) for k in range(1, 7)}
    labels |= {name: np.arange(3.0) for name in changing}
    assert words in describe_poses(labels)


def test_labels_without_poses_look_like_nothing():
    assert describe_poses({"x_mm": np.arange(3.0), "pose_1": np.zeros(3)}) == ""
