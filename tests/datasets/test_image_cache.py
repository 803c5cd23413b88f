"""The array of all images: derived from the files, and only from them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from small_data_sets import draft, header, image

from tactibench import Frame, Pose, UserError, gray_frames
from tactibench.datasets import Writer, open_dataset, verify


def test_it_holds_what_the_files_hold(closed_set: Path) -> None:
    dataset = open_dataset(closed_set)
    several = [dataset.samples[row] for row in (2, 0, 2, 3)]
    images = dataset.images(several)
    assert images.dtype == np.uint8
    assert np.array_equal(images, np.stack([dataset.image(sample) for sample in several]))
    images[:] = 0  # a copy: nobody writes into the file
    assert dataset.images(several).any()
    assert dataset.images([]).shape == (0, 9, 7)


def test_it_is_shrunk_as_models_shrink(closed_set: Path) -> None:
    dataset = open_dataset(closed_set)
    frames = [Frame(dataset.image(sample), 0.0, Pose()) for sample in dataset.samples]
    for size in (4, 16):
        assert np.array_equal(dataset.images(dataset.samples, size), gray_frames(frames, size))
    assert len(list((closed_set / ".cache").glob("*.npy"))) == 2


def test_colours_become_grey(tmp_path: Path) -> None:
    with Writer(tmp_path / "set", header(channels=3)) as writer:
        writer.add(image(0, (9, 7, 3)), id=0)
    dataset = open_dataset(tmp_path / "set")
    wanted = cv2.cvtColor(image(0, (9, 7, 3)), cv2.COLOR_RGB2GRAY)
    assert np.array_equal(dataset.images(dataset.samples)[0], wanted)


def test_files_are_decoded_once(closed_set: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = open_dataset(closed_set)
    wanted = dataset.images(dataset.samples)
    monkeypatch.setattr("tactibench.datasets.dataset.read_image", None)
    assert np.array_equal(dataset.images(dataset.samples), wanted)
    again = open_dataset(closed_set)
    assert np.array_equal(again.images(again.samples), wanted)


def test_more_samples_more_images_and_no_old_arrays(open_set: Path) -> None:
    dataset = open_dataset(open_set)
    dataset.images(dataset.samples)
    with Writer(open_set, header()) as writer:
        writer.add_many([draft(4), draft(5)])
    dataset = open_dataset(open_set)
    assert len(dataset.images(dataset.samples)) == 6
    assert len(list((open_set / ".cache").glob("*.npy"))) == 1


@pytest.mark.parametrize("name", ["npy", "json"])
def test_a_part_of_it_that_is_missing_is_made_again(closed_set: Path, name: str) -> None:
    dataset = open_dataset(closed_set)
    wanted = dataset.images(dataset.samples)
    (path,) = (closed_set / ".cache").glob(f"*.{name}")
    if name == "npy":
        path.unlink()
    else:
        path.write_text("{")
    again = open_dataset(closed_set)
    assert np.array_equal(again.images(again.samples), wanted)


def test_a_damaged_array_is_found(closed_set: Path) -> None:
    dataset = open_dataset(closed_set)
    dataset.images(dataset.samples)
    assert verify(closed_set) == []
    (path,) = (closed_set / ".cache").glob("*.npy")
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    (finding,) = verify(closed_set)
    assert f"{path.name} is damaged; delete it" in finding


def test_no_samples(tmp_path: Path) -> None:
    Writer(tmp_path / "set", header()).close()
    dataset = open_dataset(tmp_path / "set")
    assert dataset.images(dataset.samples).shape == (0, 9, 7)
    assert dataset.images(dataset.samples, 5).shape == (0, 5, 5)
    assert verify(tmp_path / "set") == []


def test_a_read_only_data_set_is_cached_elsewhere(
    closed_set: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (closed_set / ".cache").write_text("a file where the folder should be")
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    dataset = open_dataset(closed_set)
    assert len(dataset.images(dataset.samples)) == 4
    assert len(list((tmp_path / "cache/datasets").glob("*.npy"))) == 1
    (tmp_path / "file").touch()
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "file"))
    dataset = open_dataset(closed_set)
    with pytest.raises(UserError, match="TACTIBENCH_CACHE"):
        dataset.images(dataset.samples)
