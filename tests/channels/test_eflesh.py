"""The public recording of a magnetic skin, as its map imports it."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tactibench.datasets import Dataset, import_folder, open_recording, read_mapping
from tactibench.frames import served_protocols

ROOT = Path(__file__).resolve().parents[2]
RECORDINGS = Path(os.environ.get("TACTIBENCH_EFLESH", ROOT.parent / "shared" / "data" / "eflesh"))
SESSION = RECORDINGS / "20250316_155729_probe"
pytestmark = pytest.mark.skipif(
    not SESSION.is_dir(), reason=f"eFlesh is not at {RECORDINGS}; set TACTIBENCH_EFLESH"
)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    given = read_mapping(ROOT / "leaderboards" / "recordings" / "eflesh.toml")
    return import_folder(SESSION, tmp_path_factory.mktemp("skin") / "eflesh", given)


def test_every_place_was_pressed_five_times(dataset: Dataset) -> None:
    places = Counter(sample.press for sample in dataset.samples)
    assert Counter(places.values()) == {5: 31 * 31}


def test_channels_are_those_of_the_file(dataset: Dataset) -> None:
    table = np.loadtxt(SESSION / "sensor_post_baselines.csv", delimiter=",")
    stored = np.stack([dataset.signal(sample) for sample in dataset.samples])
    assert np.array_equal(stored, table[:, 1:].astype(np.float32))
    states = np.loadtxt(SESSION / "states.csv", delimiter=",")
    poses = [sample.scene.pose for sample in dataset.samples if sample.scene is not None]
    assert np.allclose([pose.x for pose in poses], states[:, 1] - 289)
    assert np.allclose([pose.depth for pose in poses], 145.5 - states[:, 3])


@pytest.mark.long
def test_it_serves_exp1_with_every_press(dataset: Dataset) -> None:
    by_name = {one.protocol: one for one in served_protocols(open_recording(dataset.folder))}
    assert by_name["exp1"].reason == "3,460 frames train, 385 validate, 960 test"
    assert not by_name["exp2"].served
