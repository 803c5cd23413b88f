"""A Bristol folder holds the same images, labels and scenes."""

from __future__ import annotations

import csv
import json
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import Dataset, Header, Sample, Writer, open_dataset
from tactibench.datasets.exporting import export
from tactibench.datasets.exporting.bristol_columns import POSE, columns_of
from tactibench.datasets.importing import ImportOptions, import_folder
from tactibench.geometry import true_contacts

Make = Callable[..., Dataset]
Good = Callable[[Dataset], list[Sample]]


def read_bristol(folder: Path) -> list[dict[str, Any]]:
    """Frames, labels and scenes of an export, read without the project's own readers."""
    columns = json.loads((folder / "collect_params.json").read_text("utf-8"))
    objects = json.loads((folder / "env_params.json").read_text("utf-8"))["objects"]
    read = []
    with (folder / "targets.csv").open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            found: dict[str, Any] = {"file": folder / "sensor_images" / row["sensor_image"]}
            found["labels"] = {
                name: float(row[column])
                for name, column in columns["labels"].items()
                if row[column]
            }
            found |= {"press": row["press"], "session": row["session"], "scene": None}
            if row.get("object_label"):
                tip = objects[row["object_label"]]
                radius = math.inf if tip["radius_mm"] is None else tip["radius_mm"]
                offsets = tuple(tuple(offset) for offset in tip["offsets_mm"])
                pose = Pose(**{key: float(row[name]) for key, name in columns["scene"].items()})
                found["scene"] = Scene(Indenter(radius, offsets, tip["name"]), pose)
            read.append(found)
    return read


@settings(max_examples=12)
@given(st.data())
def test_the_export_holds_the_same_scenes_labels_and_images(
    small_datasets: st.SearchStrategy[Any], good_of: Good, data: st.DataObject
) -> None:
    small = data.draw(small_datasets)
    with tempfile.TemporaryDirectory() as place:
        dataset = small.write(Path(place) / "v1")
        made = export(dataset, Path(place) / "bristol", "bristol")
        rows = read_bristol(made.path)
        samples = good_of(dataset)
        assert [row["file"].name for row in rows] == [f"image_{s.id + 1}.png" for s in samples]
        for row, sample in zip(rows, samples, strict=True):
            assert row["labels"] == sample.labels
            assert row["scene"] == sample.scene
            assert (row["press"], row["session"]) == (sample.press, sample.session)
            assert row["file"].read_bytes() == (dataset.folder / sample.file_name).read_bytes()
        assert (made.path / "sensor_images/image_0.png").is_file() == (small.rest is not None)
        both = [(made.path / name).read_bytes() for name in ("targets.csv", "targets_images.csv")]
        assert both[0] == both[1]
        if dataset.splits:
            split = json.loads((made.path / "splits.json").read_text("utf-8"))["mine"]
            left = {f"image_{s.id + 1}.png" for s in samples}
            test = [f"image_{number + 1}.png" for number in dataset.splits["mine"].test]
            assert split["test"] == [name for name in test if name in left]


def test_importing_it_again_gives_the_same_images_pose_labels_and_presses(
    make: Make, tmp_path: Path
) -> None:
    dataset = make(tmp_path / "v1")
    made = export(dataset, tmp_path / "bristol", "bristol")
    again = import_folder(made.path, tmp_path / "again", ImportOptions(press="press"))
    assert [s.sha256 for s in again.samples] == [s.sha256 for s in dataset.samples]
    assert [s.press for s in again.samples] == [s.press for s in dataset.samples]
    assert dataset.rest is not None
    np.testing.assert_array_equal(again.rest, dataset.rest)
    for sample, before in zip(again.samples, dataset.samples, strict=True):
        assert before.scene is not None
        pose = before.scene.pose
        found = [sample.labels[name] for name in POSE]
        assert found == [pose.x, pose.y, pose.depth, 0.0, pose.tilt, pose.yaw]


def test_importing_plates_again_gives_the_same_scenes(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    scenes = [
        Scene(Indenter.plate(), Pose(tilt=tilt, depth=depth))
        for tilt, depth in rng.uniform([-20, 0], [20, 4], (6, 2)).tolist()
    ]
    header = Header("plates", {"name": "tactip"}, (4, 5), dome_radius_mm=20.0)
    with Writer(tmp_path / "v1", header, fsync=False) as writer:
        for number, scene in enumerate(scenes):
            writer.add(np.full((4, 5), number, np.uint8), id=number, scene=scene)
    export(open_dataset(tmp_path / "v1"), tmp_path / "bristol", "bristol")
    options = ImportOptions(indenter="plate", depth="pose_z", tilt="pose_Ry")
    again = import_folder(tmp_path / "bristol", tmp_path / "again", options)
    assert [sample.scene for sample in again.samples] == scenes
    assert again.rest is None


def test_a_pose_is_a_turn_about_fixed_axes(make: Make, tmp_path: Path) -> None:
    """R = Rz(pose_Rz) Ry(pose_Ry) Rx(pose_Rx), here multiplied out, puts a plate's point of
    contact where the geometry of the scene has it: -20 mm times the plate's turned normal."""
    rng = np.random.default_rng(5)
    scenes = [
        Scene(Indenter.plate(), Pose(yaw=yaw, tilt=tilt, depth=1.0))
        for yaw, tilt in rng.uniform(-40, 40, (6, 2)).tolist()
    ]
    samples = [Sample(i, "", "", scene=scene) for i, scene in enumerate(scenes)]
    columns = columns_of(samples)
    assert columns.order()[2:8] == list(POSE)
    for scene in scenes:
        values = {column: getattr(scene.pose, key) for key, column in columns.scene.items()}
        beta, gamma = (math.radians(values[name]) for name in ("pose_Ry", "pose_Rz"))
        (cb, sb), (cg, sg) = ((math.cos(a), math.sin(a)) for a in (beta, gamma))
        about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
        about_z = np.array([[cg, -sg, 0], [sg, cg, 0], [0, 0, 1]])
        normal = about_z @ about_y @ [0, 0, -1]  # towards the sensor
        np.testing.assert_allclose(-20 * normal[:2], true_contacts(scene).xy[0], atol=1e-12)


def test_labels_that_are_poses_keep_their_columns(tmp_path: Path) -> None:
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
        "sensor_image",
        "object_label",
        "pose_x",
        "pose_y",
        "pose_Rz",
        "scene_x",
        "scene_y",
        "scene_depth",
        "scene_tilt",
        "scene_yaw",
        "move_1",
        "session_",
        "press",
        "session",
    ]


@pytest.mark.parametrize("name", ["collect_params", "env_params", "sensor_image_params"])
def test_the_params_say_what_is_known(make: Make, tmp_path: Path, name: str) -> None:
    dataset = make(tmp_path / "v1")
    export(dataset, tmp_path / "out", "bristol")
    params = json.loads((tmp_path / "out" / f"{name}.json").read_text("utf-8"))
    expected = {
        "collect_params": {
            "pose_llims": [0.0, 0.0, 2.0, 0.0, 0.0, 0.0],
            "pose_ulims": [2.0, 0.0, 2.0, 0.0, 0.0, 0.0],
            "name": "taps",
        },
        "env_params": {"dome_radius_mm": 20.0, "licence": "CC-BY-4.0", "axes": "sxyz"},
        "sensor_image_params": {"image": [16, 16], "channels": 1, "rest": "image_0.png"},
    }[name]
    assert {key: params[key] for key in expected} == expected
