"""A recording answers its own presses, in order, and says what it is."""

from __future__ import annotations

import hashlib
import json
from itertools import cycle, islice

import cv2
import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, UserError


def rows_of(folder):
    return (folder / "targets.csv").read_text().splitlines()[1:]


def rewrite(folder, rows, header=None):
    old = (folder / "targets.csv").read_text().splitlines()[0]
    (folder / "targets.csv").write_text("\n".join([header or old, *rows]) + "\n")


def test_scenes_are_plates_in_file_order_with_offset_depths(recording, open_recording):
    scenes = open_recording(recording, depth_offset_mm=4.5).scenes()
    assert list(scenes) == [f"frame_{i}_0.png" for i in range(5)]
    for row, scene in zip(rows_of(recording), scenes.values(), strict=True):
        cells = row.split(",")
        assert scene.indenter.is_plate
        assert scene.pose == Pose(depth=float(cells[2]) + 4.5, tilt=float(cells[6]))


def test_press_returns_the_frame_of_the_scene(recording, open_recording):
    with open_recording(recording) as sensor:
        for row, (name, scene) in enumerate(sensor.scenes().items()):
            got = sensor.press(scene)
            on_disk = cv2.imread(str(recording / "frames_bw" / name), cv2.IMREAD_UNCHANGED)
            np.testing.assert_array_equal(got.image, on_disk)
            assert (got.timestamp, got.pose, got.image.dtype) == (row, scene.pose, np.uint8)
            np.testing.assert_array_equal(got.rest, sensor.rest().image)


def test_frames_keep_the_order_asked_for(recording, open_recording):
    sensor = open_recording(recording)
    names = list(sensor.scenes())
    order = np.random.default_rng(3).integers(0, len(names), 300)  # longer than the look-ahead
    stamps = [frame.timestamp for frame in sensor.frames(names[i] for i in order)]
    assert stamps == order.tolist()
    frames = sensor.frames(cycle(names))  # lazy: may be left early
    assert [frame.timestamp for frame in islice(frames, 7)] == [0, 1, 2, 3, 4, 0, 1]
    frames.close()


def test_rows_with_the_same_pose_stay_apart(recording, open_recording):
    rows = rows_of(recording)
    same = rows[1].partition(",")[2]
    rows[3], rows[4] = f"frame_3_0.png,{same}", f"frame_4_0.png,{same}"
    rewrite(recording, rows)
    sensor = open_recording(recording)
    scenes = sensor.scenes()
    assert (len(scenes), len(set(scenes.values()))) == (5, 3)
    assert [f.timestamp for f in sensor.frames(reversed(scenes))] == [4, 3, 2, 1, 0]
    assert sensor.press(scenes["frame_4_0.png"]).timestamp == 1


def test_a_listed_frame_is_not_taken_for_the_rest_frame(recording, open_recording):
    frames = recording / "frames_bw"
    (frames / "init_0.png").unlink()
    (frames / "frame_0_0.png").rename(frames / "image_0.png")
    rows = rows_of(recording)
    rewrite(recording, [rows[0].replace("frame_0_0", "image_0"), *rows[1:]])
    assert open_recording(recording).describe()["rest"] is None


def test_a_press_that_was_not_recorded_is_refused(recording, open_recording):
    sensor = open_recording(recording)
    for scene in (
        Scene(Indenter.single(), Pose(1.0, 2.0, depth=3.0)),
        Scene(Indenter.plate(), Pose(depth=4.7500001, tilt=-4.0)),
    ):
        with pytest.raises(UserError, match=r"5 presses by plate .*'surface'"):
            sensor.press(scene)


@pytest.mark.parametrize("name", ["init_3.png", "the_init.png", "image_0.png"])
def test_rest_frame_by_its_other_names(recording, open_recording, name):
    frames = recording / "frames_bw"
    (frames / "init_0.png").rename(frames / name)
    sensor = open_recording(recording)
    assert sensor.describe()["rest"] == name
    np.testing.assert_array_equal(
        sensor.rest().image, cv2.imread(str(frames / name), cv2.IMREAD_UNCHANGED)
    )


def test_no_rest_frame_is_a_sentence_only_when_asked_for(recording, open_recording):
    (recording / "frames_bw" / "init_0.png").unlink()
    sensor = open_recording(recording)
    scene = next(iter(sensor.scenes().values()))
    assert sensor.press(scene).rest is None
    assert sensor.describe()["rest"] is None
    with pytest.raises(UserError, match=r"init_0\.png"):
        sensor.rest()


def test_other_label_columns(recording, open_recording):
    rows = [f"frame_{i}_0.png,0,0,{-i},{2 * i},0,0" for i in range(5)]
    rewrite(recording, rows)
    with pytest.raises(UserError, match=r"pose_2 has the same value.*pose_3 changes"):
        open_recording(recording)
    scenes = open_recording(recording, depth="pose_z", tilt="pose_4").scenes().values()
    assert [(s.pose.depth, s.pose.tilt) for s in scenes] == [(5.0 - i, 2.0 * i) for i in range(5)]


def test_description_is_json_and_its_hash_covers_every_byte(recording, open_recording):
    before = open_recording(recording).describe()
    assert json.loads(json.dumps(before)) == before
    assert str(recording.parent) not in json.dumps(before)
    assert (before["count"], before["image"], before["folder"]) == (5, [12, 10], "plates")

    digest = hashlib.sha256((recording / "targets.csv").read_bytes())
    for name in [*(f"frame_{i}_0.png" for i in range(5)), "init_0.png"]:
        data = (recording / "frames_bw" / name).read_bytes()
        digest.update(len(data).to_bytes(8, "little") + data)
    assert before["sha256"] == digest.hexdigest()


def test_trust_in_labels_is_part_of_frames_only_where_it_is_given() -> None:
    """The default refuses and changes no frame: recordings of before keep their identity."""
    from tactibench.frames import sensor_identity
    from tactibench.plugins import PluginHost
    from tactibench.records import BoundSpec

    sensors = PluginHost().sensors
    usual = BoundSpec.named(sensors, "recorded", {})
    trusting = BoundSpec.named(sensors, "recorded", {"trust_labels": "yes"})
    assert "trust_labels" not in sensor_identity(usual, {})["parameters"]
    assert sensor_identity(trusting, {})["parameters"]["trust_labels"] is True
