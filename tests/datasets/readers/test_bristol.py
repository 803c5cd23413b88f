"""Three generations of Bristol folders become the same data set."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import (
    ImportOptions,
    import_folder,
    indentation,
    open_dataset,
    open_recording,
    read_options,
    verify,
)

PLATE = ("indenter=plate", "offset_mm=5", "pivot_mm=20")


@pytest.mark.parametrize("generation", ["first", "second", "third"])
def test_every_generation_keeps_frames_labels_and_order(generation, request, tmp_path):
    folder = request.getfixturevalue(generation)
    assert open_recording(folder).format == "bristol"
    dataset = import_folder(folder, tmp_path / "out", read_options(PLATE))
    assert [sample.id for sample in dataset.samples] == list(range(5))
    assert verify(tmp_path / "out") == []
    frames = sorted(folder.rglob("*_[0-9]_0.png")) or sorted(folder.rglob("image_[1-9].png"))
    for i, (sample, path) in enumerate(zip(dataset.samples, frames, strict=True)):
        assert (tmp_path / "out" / sample.file_name).read_bytes() == path.read_bytes()
        z, t = -0.25 * (i + 1), 3.5 * i - 4.0
        depth = sample.labels.get("pose_2", sample.labels.get("pose_y"))
        tilt = sample.labels.get("pose_6", sample.labels.get("pose_Rz"))
        assert (depth, tilt) == (z, t)
        assert sample.scene.pose.tilt == t
        expected = z + 5 + 20 * (1 - np.cos(t * np.pi / 180))
        assert sample.scene.pose.depth == pytest.approx(expected, abs=1e-12)
    assert (dataset.rest is None) == (generation == "second")
    assert dataset.header.status == "closed"
    assert len({sample.press for sample in dataset.samples}) == 5


def test_without_an_indenter_labels_stay_labels(first, tmp_path):
    dataset = import_folder(first, tmp_path / "out")
    assert {sample.scene for sample in dataset.samples} == {None}
    assert dataset.header.dome_radius_mm is None
    assert dataset.samples[2].labels["move_1"] == 2.0
    assert dataset.samples[2].extra == {"kind": "obj", "source_name": "frame_2_0.png"}


def test_the_header_says_where_the_frames_came_from(first, third, tmp_path):
    dataset = import_folder(first, tmp_path / "a", read_options((*PLATE, "licence=CC0-1.0")))
    source = dataset.header.source
    assert source["files"]["meta.json"] == {"exposure": -7, "image_dir": "a\\frames_bw"}
    assert source["options"] == {
        "indenter": "plate",
        "offset_mm": 5.0,
        "pivot_mm": 20.0,
        "licence": "CC0-1.0",
    }
    assert source["columns"]["depth"] == "pose_2"
    assert source["sha256"] == open_recording(first).sha256
    assert dataset.header.licence == "CC0-1.0"
    assert (dataset.header.name, dataset.header.image) == ("first", (12, 10))
    other = import_folder(third, tmp_path / "b").header.source["files"]
    assert sorted(other) == ["collect_params.json", "sensor_image_params.json"]


def test_rows_without_a_file_are_left_out_when_asked(third, tmp_path):
    (third / "sensor_images" / "image_2.png").unlink()
    dataset = import_folder(third, tmp_path / "out", ImportOptions(missing="skip"))
    assert [s.extra["source_name"] for s in dataset.samples] == [
        f"image_{i}.png" for i in (1, 3, 4, 5)
    ]
    assert any(
        "rows of targets.csv left out, no file: 1" in n for n in dataset.header.source["notes"]
    )


def test_byte_order_mark_and_decimal_commas_throughout(first, tmp_path):
    before = open_recording(first)
    lines = (first / "targets.csv").read_text().splitlines()
    text = "\n".join(line.replace(",", ";").replace(".", ",") for line in lines)
    text = text.replace(",png", ".png")
    (first / "targets.csv").write_bytes("﻿".encode() + text.encode())
    after = open_recording(first)
    assert after.names == before.names
    for column, values in before.labels.items():
        np.testing.assert_array_equal(after.labels[column], values)


def test_colour_frames_and_a_negative_depth(first, tmp_path):
    import cv2

    bgr = np.random.default_rng(8).integers(0, 256, (12, 10, 3), dtype=np.uint8)
    for path in (first / "frames_bw").iterdir():
        cv2.imwrite(str(path), bgr)
    options = read_options(("indenter=plate", "depth=-pose_2"))
    dataset = import_folder(first, tmp_path / "out", options)
    assert dataset.header.channels == 3
    np.testing.assert_array_equal(dataset.signal(dataset.samples[0]), bgr[..., ::-1])
    assert [s.scene.pose.depth for s in dataset.samples] == [0.25, 0.5, 0.75, 1.0, 1.25]


def test_an_8_bit_frame_with_alpha_is_written_anew(first, tmp_path):
    import cv2

    alpha = np.random.default_rng(8).integers(0, 256, (12, 10, 4), dtype=np.uint8)
    for path in (first / "frames_bw").iterdir():
        cv2.imwrite(str(path), alpha)
    dataset = import_folder(first, tmp_path / "out")
    np.testing.assert_array_equal(dataset.signal(dataset.samples[0]), alpha[..., 2::-1])


def test_a_plate_touches_at_the_domes_radius_times_the_sine(first, tmp_path):
    options = read_options((*PLATE, "dome_radius_mm=25", "yaw_deg=90"))
    dataset = import_folder(first, tmp_path / "out", options)
    sample = dataset.samples[4]
    assert sample.scene == Scene(
        Indenter.plate(),
        Pose(yaw=90.0, tilt=10.0, depth=float(indentation(-1.25, 10.0, 5.0, 20.0))),
    )
    (xy,) = dataset.contacts(sample).xy
    np.testing.assert_allclose(xy, [0, 25 * np.sin(np.radians(10))], atol=1e-12)


def test_a_data_set_opens_as_the_recording_it_came_from(first, tmp_path):
    before = open_recording(first)
    import_folder(first, tmp_path / "out")
    after = open_recording(tmp_path / "out")
    assert (after.format, after.names, after.presses) == ("v1", before.names, before.presses)
    for row in range(5):
        np.testing.assert_array_equal(after.image(row), before.image(row))
    np.testing.assert_array_equal(after.rest_image(), before.rest_image())
    for column, values in before.labels.items():
        np.testing.assert_array_equal(after.labels[column], values)
    assert open_dataset(tmp_path / "out").sha256 == after.sha256
