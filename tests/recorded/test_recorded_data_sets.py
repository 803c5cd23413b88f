"""The sensor reads v1 data sets, CSV folders and image folders like Bristol folders."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import (
    Draft,
    Header,
    Split,
    Writer,
    open_dataset,
    write_split,
)


def image(index):
    return np.random.default_rng(index).integers(0, 256, (12, 10), dtype=np.uint8)


@pytest.fixture
def data_set(tmp_path):
    """Scene or None of every sample -> a folder; two samples a press."""

    def made(scenes, rest=True, **keys):
        folder = tmp_path / "set"
        header = Header("set", {"name": "tactip"}, (12, 10), **keys)
        with Writer(folder, header, fsync=False) as writer:
            if rest:
                writer.reference(image(99))
            for i, scene in enumerate(scenes):
                writer.add(Draft(image(i), id=i, scene=scene, press=f"p{i // 2}"))
        return folder

    return made


SINGLE = [Scene(Indenter.single(), Pose(float(i), -1.0, depth=1.0 + i)) for i in range(4)]


def test_scenes_are_taken_as_they_are(data_set, open_recording):
    sensor = open_recording(data_set(SINGLE, dome_radius_mm=25.0), depth_offset_mm=9.0)
    assert list(sensor.scenes().values()) == SINGLE
    assert list(sensor.presses().values()) == ["p0", "p0", "p1", "p1"]
    assert (sensor.dome_radius_mm, sensor.deepest_mm) == (25.0, math.inf)
    with sensor:
        for i, frame in enumerate(sensor.press_many(SINGLE)):
            np.testing.assert_array_equal(frame.image, image(i))
            np.testing.assert_array_equal(frame.rest, image(99))
            assert frame.pose == SINGLE[i].pose
    assert sensor.describe()["format"] == "v1"
    assert sensor.describe()["rest"] == "rest"


def test_forces_are_written_read_and_pressed(tmp_path, open_recording):
    header = Header("set", {"name": "tactip"}, (12, 10), dome_radius_mm=20.0)
    scene, force = SINGLE[0], ((0.1, -0.2, -0.9),)
    with Writer(tmp_path / "set", header) as writer:
        writer.reference(image(99))
        for i in range(2):
            writer.add(Draft(image(i), id=i, scene=scene, contacts_force_n=force))
        with pytest.raises(UserError, match=r"sample 2: force .* one force for every contact"):
            writer.add(Draft(image(2), id=2, scene=scene, contacts_force_n=force * 2))
    dataset = open_dataset(tmp_path / "set")
    assert dataset.contacts(dataset.samples[1]).force.tolist() == [list(force[0])]
    with open_recording(tmp_path / "set") as sensor:
        assert sensor.press(scene).force.tolist() == [list(force[0])]


def test_a_split_says_who_trains_validates_and_tests(data_set, open_recording):
    folder = data_set([*SINGLE, *SINGLE])
    split = Split((0, 1), (2, 3), (6, 7))
    write_split(folder, "by-hand", split, open_dataset(folder).samples)
    names = list(open_recording(folder).scenes())
    assert open_recording(folder).split() == {}
    chosen = open_recording(folder, split="by-hand").split()
    parts = ["train", "train", "validation", "validation", None, None, "test", "test"]
    assert [chosen.get(name) for name in names] == parts


def test_a_split_that_is_not_there(data_set, recording, open_recording):
    with pytest.raises(UserError, match=r"has no splits/mine\.json"):
        open_recording(data_set(SINGLE), split="mine")
    with pytest.raises(UserError, match=r"has no splits/mine\.json"):
        open_recording(recording, split="mine")


def test_the_pivot_lifts_tilted_presses(recording, open_recording):
    flat, lifted = (open_recording(recording, pivot_mm=p).scenes() for p in (0.0, 20.0))
    for name, scene in flat.items():
        tilt = math.radians(scene.pose.tilt)
        expected = scene.pose.depth + 20 * (1 - math.cos(tilt))
        assert lifted[name].pose.depth == pytest.approx(expected, abs=1e-12)


def test_no_rest_frame_and_no_scene(data_set, open_recording):
    folder = data_set(SINGLE, rest=False)
    with pytest.raises(UserError, match="no frame of the undeformed sensor"):
        open_recording(folder).rest()


def test_samples_of_which_nothing_is_known(data_set, open_recording):
    with pytest.raises(UserError, match="no column 'pose_2'"):
        open_recording(data_set([None, None]))
