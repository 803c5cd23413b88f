"""Images that changed are named and refused; the array of all is derived from the files alone."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from png_bytes import png
from small_data_sets import draft, header, image

from tactibench import Frame, Pose, UserError, gray_frames
from tactibench.datasets import Draft, Writer, open_dataset, verify

NAME = "images/000000/000002.png"


def other_pixels(data: bytes) -> bytes:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    return cv2.imencode(".png", image ^ 1)[1].tobytes()


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda data: b"", "is not a PNG"),
        (lambda data: b"GIF89a" + data, "is not a PNG"),
        (lambda data: data[:-1], "is cut short"),
        (lambda data: data[: len(data) // 2], "is cut short"),
        (lambda data: data[:50] + bytes([data[50] ^ 1]) + data[51:], "is damaged"),
        (other_pixels, "was changed after it was written"),
        (lambda data: png(90_000, 90_000, b""), "was changed after it was written"),
    ],
)
def test_a_changed_file_is_named_wherever_it_is_read(
    closed_set: Path, damage: Callable[[bytes], bytes], says: str
) -> None:
    path = closed_set / NAME
    path.write_bytes(damage(path.read_bytes()))
    dataset = open_dataset(closed_set)  # lazily: opening reads no image
    sentence = rf"000002\.png {says}.*\(metadata\.jsonl line 3\)"
    for work in (
        lambda: dataset.image(dataset.samples[2]),
        lambda: dataset.images(dataset.samples[:1]),
        lambda: dataset.images(dataset.samples[:1], size=4),
    ):
        with pytest.raises(UserError, match=sentence):
            work()
    assert list((closed_set / ".cache").glob("*.npy")) == []
    dataset.image(dataset.samples[1])
    (finding,) = verify(closed_set)
    assert "000002.png" in finding
    assert says in finding


def test_a_bomb_that_was_written_with_its_own_checksum_is_never_decoded(
    open_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Size and pixels are those of the header before a byte is decompressed."""
    monkeypatch.setattr(cv2, "imdecode", None)
    journal = open_set / "metadata.jsonl"
    before, sha256 = journal.read_text("utf-8"), open_dataset(open_set).samples[2].sha256
    for data in (png(90_000, 90_000, zlib.compress(b"")), png(8, 9, zlib.compress(b"x" * 81))):
        (open_set / NAME).write_bytes(data)
        journal.write_text(before.replace(sha256, hashlib.sha256(data).hexdigest()), "utf-8")
        dataset = open_dataset(open_set)
        with pytest.raises(UserError, match=r"changed its size to .*it was 9x7"):
            dataset.image(dataset.samples[2])


def test_a_kept_png_must_be_plain(tmp_path: Path) -> None:
    deep = cv2.imencode(".png", image(0).astype(np.uint16) * 257)[1].tobytes()
    clear = cv2.imencode(".png", np.dstack([image(0)] * 4))[1].tobytes()
    colour = cv2.imencode(".png", np.dstack([image(0)] * 3))[1].tobytes()
    short = cv2.imencode(".png", image(0))[1].tobytes()[:-3]
    junk = png(7, 9, b"junk")
    with Writer(tmp_path / "set", header()) as writer:
        for data, says in (
            (deep, "not an 8-bit 9x7 gray PNG"),
            (clear, "not an 8-bit 9x7 gray PNG"),
            (colour, "not an 8-bit 9x7 gray PNG"),
            (short, "cut short"),
            (junk, "cannot be decoded"),
        ):
            with pytest.raises(UserError, match=f"the frame of sample 0 .*{says}"):
                writer.add(Draft(data, id=0))


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
        writer.add(Draft(image(0, (9, 7, 3)), id=0))
    dataset = open_dataset(tmp_path / "set")
    expected = cv2.cvtColor(image(0, (9, 7, 3)), cv2.COLOR_RGB2GRAY)
    assert np.array_equal(dataset.images(dataset.samples)[0], expected)


def test_files_are_decoded_once(closed_set: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = open_dataset(closed_set)
    expected = dataset.images(dataset.samples)
    monkeypatch.setattr("tactibench.datasets.dataset.read_image", None)
    assert np.array_equal(dataset.images(dataset.samples), expected)
    again = open_dataset(closed_set)
    assert np.array_equal(again.images(again.samples), expected)


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
    expected = dataset.images(dataset.samples)
    (path,) = (closed_set / ".cache").glob(f"*.{name}")
    if name == "npy":
        path.unlink()
    else:
        path.write_text("{")
    again = open_dataset(closed_set)
    assert np.array_equal(again.images(again.samples), expected)


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
