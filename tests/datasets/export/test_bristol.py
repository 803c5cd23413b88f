"""A Bristol folder holds the same samples, and an import of it makes the same data set."""

from __future__ import annotations

import csv
import json
import math
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from small_data_sets import Small, draft, good, header, smalls, write_taps

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import (
    LETTERED,
    ImportOptions,
    Sample,
    Writer,
    columns_of,
    export_dataset,
    import_folder,
    open_dataset,
    open_recording,
    verify,
)
from tactibench.geometry import true_contacts

SAMPLE_FIELDS = (
    *("id", "file_name", "sha256", "scene", "labels", "press", "session", "attempt", "t_frame_ns"),
)
HEADER_FIELDS = (
    *("sensor", "image", "channels", "dome_radius_mm", "units", "axes", "frames", "licence"),
)


def read_bristol(folder: Path) -> list[dict[str, Any]]:
    """Frames, labels and scenes of an export, read without the project's own readers."""
    columns = json.loads((folder / "collect_params.json").read_text("utf-8"))
    objects = json.loads((folder / "env_params.json").read_text("utf-8"))["objects"]
    read = []
    with (folder / "targets.csv").open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            sample: dict[str, Any] = {"file": folder / "sensor_images" / row["sensor_image"]}
            sample["labels"] = {
                name: float(row[column])
                for name, column in columns["labels"].items()
                if row[column]
            }
            sample |= {"press": row["press"], "session": row["session"], "scene": None}
            if row.get("object_label"):
                tip = objects[row["object_label"]]
                radius = math.inf if tip["radius_mm"] is None else tip["radius_mm"]
                offsets = tuple(tuple(offset) for offset in tip["offsets_mm"])
                pose = Pose(**{key: float(row[name]) for key, name in columns["scene"].items()})
                sample["scene"] = Scene(Indenter(radius, offsets, tip["name"]), pose)
            read.append(sample)
    return read


@settings(max_examples=25, deadline=None)
@given(smalls())
def test_the_export_holds_the_samples_and_the_import_makes_the_data_set_again(small: Small) -> None:
    with tempfile.TemporaryDirectory() as place:
        dataset = small.write(Path(place) / "v1")
        folder = export_dataset(dataset, Path(place) / "bristol", "bristol").path
        rows, samples = read_bristol(folder), good(dataset)
        assert [row["file"].name for row in rows] == [f"image_{s.id + 1}.png" for s in samples]
        for row, sample in zip(rows, samples, strict=True):
            for key in ("labels", "scene", "press", "session"):
                assert row[key] == getattr(sample, key)
            assert row["file"].read_bytes() == (dataset.folder / sample.file_name).read_bytes()
        assert (folder / "sensor_images/image_0.png").is_file() == (small.rest is not None)
        both = [(folder / name).read_bytes() for name in ("targets.csv", "targets_images.csv")]
        assert both[0] == both[1]

        again = import_folder(folder, Path(place) / "again")
        for new, sample in zip(again.samples, samples, strict=True):
            extra = {**sample.extra, "source_name": f"image_{sample.id + 1}.png"}
            assert dict(new.extra) == extra
            for key in SAMPLE_FIELDS:
                assert getattr(new, key) == getattr(sample, key)
        for key in HEADER_FIELDS:
            assert getattr(again.header, key) == getattr(dataset.header, key)
        assert again.header.name == (dataset.header.name or "bristol")
        ids = {sample.id for sample in samples}
        for name, split in dataset.splits.items():
            assert set(again.splits[name].test) == set(split.test) & ids
        assert again.splits.keys() == dataset.splits.keys()
        if dataset.rest is None:
            assert again.rest is None
        else:
            np.testing.assert_array_equal(again.rest, dataset.rest)
        assert verify(again.folder) == []


def test_an_option_reads_an_export_as_any_other_folder(tmp_path: Path) -> None:
    dataset = write_taps(tmp_path / "v1")
    export_dataset(dataset, tmp_path / "bristol", "bristol")
    options = ImportOptions(indenter="plate", depth="pose_x", tilt="pose_Ry", press="session")
    recording = open_recording(tmp_path / "bristol", options)
    assert {scene.indenter.name for scene in recording.scenes if scene} == {"plate"}
    assert set(recording.presses) == {"day 1"}
    assert [scene.pose.depth for scene in recording.scenes if scene] == [
        0.5 * row for row in range(5)
    ]


def test_a_column_that_somebody_added_is_kept_and_a_lost_frame_leaves_its_split(
    tmp_path: Path,
) -> None:
    folder = export_dataset(write_taps(tmp_path / "v1"), tmp_path / "bristol", "bristol").path
    lines = (folder / "targets.csv").read_text().splitlines()
    lines = [f"{line},{'note' if row == 0 else row}" for row, line in enumerate(lines)]
    (folder / "targets.csv").write_text("\n".join(lines))
    lost = json.loads((folder / "splits.json").read_text())["mine"]["test"][0]
    (folder / "sensor_images" / lost).unlink()
    again = import_folder(folder, tmp_path / "again", ImportOptions(missing="skip"))
    assert [sample.extra["note"] for sample in again.samples] == ["2", "3", "4", "5"]
    assert again.splits["mine"].test == (1,)


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("env_params.json", '"radius_mm": 3.0', '"radius_mm": -3.0', "radius is -3.0"),
        ("env_params.json", '"radius_mm": 3.0', '"radius_mm": "big"', "radius_mm' is 'big'"),
        ("env_params.json", '"licence"', '"license"', "the key 'licence' is missing"),
        ("collect_params.json", '"tilt"', '"tild"', "tild"),
        ("collect_params.json", '"pose_z"', '"pose_zz"', "no column pose_zz"),
        ("targets.csv", "png,1,", "png,9,", "row 1: object_label is '9'"),
        ("targets.csv", "png,1,0.0,", "png,1,,", "row 1: pose_x is empty"),
        ("targets.csv", "png,1,0.0,", "png,1,left,", "row 1: pose_x is 'left'"),
        ("targets.csv", "1000000000000000000", "noon", "row 1: .*'noon'"),
        ("splits.json", '"image_1.png"', '"image_77.png"', "names 'image_77.png'"),
        ("splits.json", '"mine": {', '"mine": [], "x": {', "lists of frames by split"),
    ],
)
def test_a_mistake_in_an_edited_export_names_its_file(
    tmp_path: Path, file: str, old: str, new: str, says: str
) -> None:
    folder = export_dataset(write_taps(tmp_path / "v1"), tmp_path / "bristol", "bristol").path
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))
    with pytest.raises(UserError, match=says):
        open_recording(folder)


def test_a_pose_is_a_turn_about_fixed_axes() -> None:
    """R = Rz(pose_Rz) Ry(pose_Ry) Rx(pose_Rx), here multiplied out, puts a plate's point of
    contact where the geometry of the scene has it: -20 mm times the plate's turned normal."""
    rng = np.random.default_rng(5)
    scenes = [
        Scene(Indenter.plate(), Pose(yaw=yaw, tilt=tilt, depth=1.0))
        for yaw, tilt in rng.uniform(-40, 40, (6, 2)).tolist()
    ]
    samples = [Sample(i, "", "", scene=scene) for i, scene in enumerate(scenes)]
    columns = columns_of(samples)
    assert columns.order()[2:8] == list(LETTERED)
    for scene in scenes:
        values = {column: getattr(scene.pose, key) for key, column in columns.scene.items()}
        beta, gamma = (math.radians(values[name]) for name in ("pose_Ry", "pose_Rz"))
        (cb, sb), (cg, sg) = ((math.cos(a), math.sin(a)) for a in (beta, gamma))
        about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
        about_z = np.array([[cg, -sg, 0], [sg, cg, 0], [0, 0, 1]])
        normal = about_z @ about_y @ [0, 0, -1]  # towards the sensor
        np.testing.assert_allclose(-20 * normal[:2], true_contacts(scene).xy[0], atol=1e-12)


def test_labels_that_are_poses_keep_their_columns() -> None:
    scene = Scene(Indenter.single(), Pose(1.0, 2.0, depth=3.0))
    labels = {"pose_1": 0.0, "pose_2": -1.5, "pose_6": 3.0, "move_1": 4.0, "session": 1.0}
    columns = columns_of([Sample(0, "", "", scene=scene, labels=labels)])
    assert columns.labels == {
        "pose_1": "pose_x",
        "pose_2": "pose_y",
        "pose_6": "pose_Rz",
        "move_1": "move_1",
        "session": "session_",
    }
    assert columns.scene["depth"] == "scene_depth"
    assert columns.order() == [
        *("sensor_image", "object_label", "pose_x", "pose_y", "pose_Rz"),
        *("scene_x", "scene_y", "scene_depth", "scene_tilt", "scene_yaw", "move_1", "session_"),
        *("press", "session"),
    ]


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        (
            "collect",
            {
                "pose_llims": [0.0, 0.0, 2.0, 0.0, 0.0, 0.0],
                "pose_ulims": [2.0, 0.0, 2.0, 0.0, 0.0, 0.0],
                "name": "taps",
            },
        ),
        ("env", {"dome_radius_mm": 20.0, "licence": "CC-BY-4.0", "axes": "sxyz"}),
        ("sensor_image", {"image": [16, 16], "channels": 1, "rest": "image_0.png"}),
    ],
)
def test_the_params_say_what_is_known(tmp_path: Path, name: str, facts: dict[str, Any]) -> None:
    folder = export_dataset(write_taps(tmp_path / "v1"), tmp_path / "out", "bristol").path
    params = json.loads((folder / f"{name}_params.json").read_text("utf-8"))
    assert {key: params[key] for key in facts} == facts


def test_how_an_indenter_was_moved_sideways_comes_back(tmp_path: Path) -> None:
    moved = Scene(Indenter.dual(8.0), Pose(1.0, 2.0, 30.0, depth=3.0, dx=0.5, dy=-0.25, dyaw=4.0))
    still = Scene(Indenter.single(), Pose(depth=1.0))
    with Writer(tmp_path / "set", header()) as writer:
        writer.add_many([replace(draft(0), scene=moved), replace(draft(1), scene=still)])
    export_dataset(open_dataset(tmp_path / "set"), tmp_path / "out", "bristol")
    first = (tmp_path / "out" / "targets.csv").read_text().splitlines()[0]
    assert "shear_x,shear_y,shear_Rz" in first
    again = import_folder(tmp_path / "out", tmp_path / "again")
    assert [sample.scene for sample in again.samples] == [moved, still]
