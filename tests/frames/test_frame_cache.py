"""Generated frames: the same however often they were interrupted; damage is never used."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated import entry_of, open_frames

from tactibench import Frame, Indenter, Pose, Scene, UserError
from tactibench.frames import GeneratedFrameSet
from tactibench.frames import cache as generated
from tactibench.geometry import true_contacts

RequestOf = Callable[..., GeneratedFrameSet]


def files(cache: Path) -> list[str]:
    """What lies in the cache, locks apart."""
    found = [p.relative_to(cache / "frames").as_posix() for p in cache.rglob("*") if p.is_file()]
    return sorted(name for name in found if not name.endswith(".lock"))


def images(request: GeneratedFrameSet, cache: Path) -> np.ndarray:
    return np.array([frame.image for frame in open_frames(request, cache).frames])


def test_frames_come_once_and_again_from_the_disk(
    request_of: RequestOf, counter: Any, tmp_path: Path
) -> None:
    request = request_of()
    told: list[int] = []
    assert not entry_of(request, tmp_path).cached
    first = open_frames(request, tmp_path, told.append)
    assert sum(told) == counter.presses == 25
    assert entry_of(request, tmp_path).cached
    again = open_frames(request_of(), tmp_path)
    assert counter.presses == 25
    assert first.hash == again.hash
    assert first.names[2] == "some-6"
    for one, two in zip(first.frames, again.frames, strict=True):
        np.testing.assert_array_equal(one.image, two.image)
        assert one.rest is not None
        assert one.rest.shape == one.image.shape
    folder = entry_of(request, tmp_path).folder.name
    parts = ("frames.npy", "manifest.json", "poses.npy", "rest.npy")
    assert files(tmp_path) == [f"{folder}/{part}" for part in parts]


def test_every_press_has_noise_of_its_own_across_chunks(
    request_of: RequestOf, tmp_path: Path
) -> None:
    frames = images(request_of(), tmp_path).reshape(25, -1)
    assert len({frame.tobytes() for frame in frames}) == 25
    for seed in ((6, 1, 0), (5, 2, 0), (5, 1, 1)):
        others = images(request_of(seed=seed), tmp_path).reshape(25, -1)
        assert not {f.tobytes() for f in frames} & {f.tobytes() for f in others}


@pytest.mark.parametrize("fail_at", [0, 6, 7, 24])
def test_an_interrupted_generation_goes_on_and_ends_the_same(
    request_of: RequestOf, counter: Any, tmp_path: Path, fail_at: int
) -> None:
    undisturbed = open_frames(request_of(), tmp_path / "a")
    counter.presses, counter.fail_at, counter.error = 0, fail_at, KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt):
        open_frames(request_of(), tmp_path / "b")
    assert not entry_of(request_of(), tmp_path / "b").cached
    counter.fail_at, counter.presses = None, 0
    resumed = open_frames(request_of(), tmp_path / "b")
    assert counter.presses == 25 - fail_at // 7 * 7  # finished chunks are not made again
    assert resumed.hash == undisturbed.hash
    assert files(tmp_path / "a") == files(tmp_path / "b")


def flip(path: Path) -> None:
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 1
    path.write_bytes(raw)


def test_a_damaged_data_set_is_made_again(
    request_of: RequestOf, counter: Any, tmp_path: Path
) -> None:
    first = open_frames(request_of(), tmp_path)
    flip(entry_of(request_of(), tmp_path).folder / "frames.npy")
    assert open_frames(request_of(), tmp_path).hash == first.hash
    assert counter.presses == 50


def test_a_damaged_chunk_is_made_again(request_of: RequestOf, counter: Any, tmp_path: Path) -> None:
    undisturbed = open_frames(request_of(), tmp_path / "a").hash
    counter.presses, counter.fail_at = 0, 20
    with pytest.raises(RuntimeError):
        open_frames(request_of(), tmp_path / "b")
    parts = sorted((tmp_path / "b").rglob("chunk-*"))
    assert len(parts) == 2
    flip(parts[0])
    counter.presses, counter.fail_at = 0, None
    assert open_frames(request_of(), tmp_path / "b").hash == undisturbed
    assert counter.presses == 25 - 7


def test_frames_are_mapped_and_cannot_be_written(request_of: RequestOf, tmp_path: Path) -> None:
    frame = open_frames(request_of(), tmp_path).frames[3]
    assert isinstance(frame.image, np.memmap)
    assert frame.rest is not None
    for image in (frame.image, frame.rest):
        with pytest.raises(ValueError, match="read-only"):
            image[0, 0] = 1


def test_truth_is_of_the_poses_reached(request_of: RequestOf, tmp_path: Path) -> None:
    presses = open_frames(request_of(offset=0.25), tmp_path)
    asked = request_of().scenes
    for frame, scene, reached in zip(presses.frames, asked, presses.reached(), strict=True):
        assert frame.pose.x == reached.pose.x == scene.pose.x + 0.25
    truth = presses.truth("contacts", 20.0)
    assert truth[0].xy[0, 0] == pytest.approx(0.25)  # type: ignore[union-attr]


def test_the_key_holds_every_ingredient(
    request_of: RequestOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenes = request_of().scenes
    pose = Pose(**{**vars(scenes[0].pose), "yaw": 1e-9})
    keys = [
        request_of().key,
        request_of(24).key,
        request_of(seed=(6, 1, 0)).key,
        request_of(seed=(5, 2, 0)).key,
        request_of(seed=(5, 1, 1)).key,
        request_of(identity={"name": "other"}).key,
        request_of(identity={"name": "noise", "offset": 0.0, "code": "x"}).key,
        request_of(scenes=(Scene(scenes[0].indenter, pose), *scenes[1:])).key,
        request_of(scenes=(Scene(Indenter.single(2.0), scenes[0].pose), *scenes[1:])).key,
        request_of(scenes=(Scene(Indenter.plate(), scenes[0].pose), *scenes[1:])).key,
        request_of(scenes=(scenes[1], scenes[0], *scenes[2:])).key,
        *(request_of(dome_radius=radius).key for radius in (math.inf, 15.0, 25.0)),
    ]
    monkeypatch.setattr(generated, "CHUNK", 8)
    keys.append(request_of().key)
    monkeypatch.setattr(generated, "CHUNK", 7)
    monkeypatch.setattr(np, "__version__", "0")
    keys.append(request_of().key)
    assert len(set(keys)) == len(keys)
    monkeypatch.undo()


@pytest.mark.parametrize("wrong", ["fewer", "shape", "type"])
def test_a_sensor_that_answers_wrongly_is_named(
    request_of: RequestOf, tmp_path: Path, wrong: str
) -> None:
    request = request_of()

    def build(context: Any) -> Any:
        sensor = request.build(context)
        true_press = sensor.press

        def press_many(scenes: Any) -> list[Frame]:
            frames = [true_press(scene) for scene in scenes]
            if wrong == "fewer":
                return frames[1:]
            images = [f.image[1:] if wrong == "shape" else f.image / 2.0 for f in frames]
            return [Frame(i, 0.0, f.pose) for i, f in zip(images, frames, strict=True)]

        sensor.press_many = press_many  # type: ignore[method-assign]
        return sensor

    with pytest.raises(UserError, match="sensor 'noise' made"):
        open_frames(request_of(build=build), tmp_path)
    assert not entry_of(request, tmp_path).cached


def test_equal_frames_have_one_hash_whatever_code_made_them(
    request_of: RequestOf, tmp_path: Path
) -> None:
    """Rows of two versions of the code stand in one table when they were asked the same."""
    first, other = request_of(), request_of()
    other = replace(other, identity={**other.identity, "code": "newer"})
    assert other.key != first.key
    assert open_frames(other, tmp_path).hash == open_frames(first, tmp_path).hash
    flat = replace(first, dome_radius=math.inf)
    assert open_frames(flat, tmp_path).hash != open_frames(first, tmp_path).hash


# -- frames of several sensor instances


class TwoInstances:
    """Presses are made on one of two instances in turn; the sensor itself is a third."""

    def __init__(self, sensor: Any) -> None:
        self.sensor = sensor
        self.rests = [np.full(sensor.rest().image.shape, level, np.uint8) for level in (40, 60)]

    def __enter__(self) -> TwoInstances:
        self.sensor.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def rest(self) -> Frame:
        return self.sensor.rest()

    def press_many(self, scenes: Any) -> Any:
        for scene in scenes:
            frame = self.sensor.press(scene)
            number = round(100 * scene.pose.x) % 3
            yield replace(frame, rest=None if number == 2 else self.rests[number].copy())


def test_frames_bring_the_rest_frame_of_their_own_instance(
    request_of: RequestOf, counter: Any, tmp_path: Path
) -> None:
    one = request_of()
    request = replace(one, build=lambda context: TwoInstances(one.build(context)), seed=(6, 1, 0))
    made = open_frames(request, tmp_path)
    counter.presses = 0
    again = open_frames(request, tmp_path)
    assert counter.presses == 0
    assert made.hash == again.hash
    for presses in (made, again):
        for k, frame in enumerate(presses.frames):
            assert frame.rest is not None
            assert not frame.rest.flags.writeable
            assert np.unique(frame.rest).tolist() == [(40, 60, 0)[k % 3]]
        shared = {id(frame.rest) for frame in presses.frames}
        assert len(shared) == 3  # one array an instance, not one a press
    folder = entry_of(request, tmp_path).folder
    assert np.load(folder / "rests.npy").shape == (3, *np.load(folder / "rest.npy").shape)


def test_a_changed_rest_frame_is_another_content_and_damage_is_made_again(
    request_of: RequestOf, counter: Any, tmp_path: Path
) -> None:
    one = request_of()
    request = replace(one, build=lambda context: TwoInstances(one.build(context)), seed=(7, 1, 0))
    made = open_frames(request, tmp_path)
    folder = entry_of(request, tmp_path).folder
    plain = open_frames(replace(one, seed=(7, 1, 0), identity={"name": "plain"}), tmp_path)
    assert all(
        np.array_equal(a.image, b.image) for a, b in zip(made.frames, plain.frames, strict=True)
    )
    assert plain.hash != made.hash
    np.save(folder / "rest_of.npy", np.zeros(25, dtype=np.intp))
    counter.presses = 0
    assert open_frames(request, tmp_path).hash == made.hash
    assert counter.presses == 25


def test_a_rest_frame_of_another_shape_is_refused(request_of: RequestOf, tmp_path: Path) -> None:
    class Misshapen(TwoInstances):
        def __init__(self, sensor: Any) -> None:
            super().__init__(sensor)
            self.rests[1] = np.zeros((3, 3), np.uint8)

    one = request_of()
    request = replace(one, build=lambda context: Misshapen(one.build(context)), seed=(8, 1, 0))
    with pytest.raises(UserError, match=r"rest frame of shape \(3, 3\)"):
        open_frames(request, tmp_path)


@pytest.mark.parametrize("radius", [math.inf, 12.0])
def test_truth_is_on_the_sensors_surface(
    request_of: RequestOf, tmp_path: Path, radius: float
) -> None:
    presses = open_frames(request_of(dome_radius=radius), tmp_path)
    assert presses.dome_radius == radius
    for answer, scene in zip(presses.truth("contacts", 20.0), presses.reached(), strict=True):
        found: Any = answer
        np.testing.assert_array_equal(found.depth, true_contacts(scene, radius).depth)
