"""Raw pictures of a camera, and recordings without a frame of the undeformed sensor."""

from __future__ import annotations

from pathlib import Path

import cv2
import drawn_pins
import numpy as np
import pytest
from raw_camera import LEFT, SIDE, TOP, raw_frame

from tactibench import UserError
from tactibench.datasets import import_folder, open_recording, read_options
from tactibench.markers import Tracker, count_pins, find_pin_view, is_raw

PLACES = [(x, y) for x in (-3.0, 0.0, 3.0) for y in (-3.0, 0.0, 3.0)]


def write_folder(folder: Path, depths: list[float], *, rest: bool, raw: bool) -> Path:
    """Write presses at nine places, as pictures and a table of x, y and depth."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    rows = ["file_name,x_mm,y_mm,depth_mm"]
    pins = [(f"f{i}.png", *PLACES[i % 9], depth) for i, depth in enumerate(depths)]
    for name, x, y, depth in [*pins, *([("init_0.png", 0.0, 0.0, 0.0)] if rest else [])]:
        image = drawn_pins.draw(drawn_pins.pushed(x, y, depth))
        assert cv2.imwrite(str(folder / name), raw_frame(image, rng) if raw else image)
        if name != "init_0.png":
            rows.append(f"{name},{x},{y},{depth}")
    (folder / "labels.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_all_pins_of_a_raw_picture_are_found_and_no_reflection() -> None:
    rng = np.random.default_rng(1)
    pins = drawn_pins.hexagon()
    raw = raw_frame(drawn_pins.draw(pins), rng)
    view = find_pin_view(raw)
    seen = view.of(raw)
    assert is_raw(raw)
    assert seen.shape == (view.size, view.size)
    found = (Tracker(seen).rest + 0.5) * view.side / view.size - 0.5 + (view.left, view.top)
    scale = SIDE / drawn_pins.SIZE
    truth = (pins + 0.5) * scale - 0.5 + (LEFT, TOP)
    apart = np.linalg.norm(found[:, None] - truth, axis=2)
    assert apart.min(axis=1).max() < 1.0  # nothing else is taken for a pin
    assert (apart.min(axis=0) < 1.0).mean() > 0.9  # a reflection may lie on a pin


def test_noise_is_neither_raw_nor_followed() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (480, 640), dtype=np.uint8)
    assert not is_raw(noise)
    with pytest.raises(UserError, match="light=as_is"):
        find_pin_view(noise)
    with pytest.raises(UserError, match="light=even"):
        count_pins(noise)
    assert not is_raw(drawn_pins.draw(drawn_pins.pushed(1.0, -2.0, 3.0)))  # made for pins


def test_raw_frames_are_imported_cut_out_unless_somebody_objects(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "raw", [1.0, 3.0], rest=True, raw=True)
    recording = open_recording(folder)
    assert "raw camera frames" in " ".join(recording.notes)
    dataset = import_folder(recording, tmp_path / "even", read_options([]))
    assert dataset.rest is not None
    pins = Tracker(dataset.rest)
    assert abs(len(pins.rest) - len(drawn_pins.hexagon())) <= 2
    assert pins.track(np.stack([dataset.signal(s) for s in dataset.samples])).seen.mean() > 0.95
    kept = open_recording(folder, read_options(["light=as_is"]))
    assert kept.image(0).shape == (480, 640, 3)


def test_a_missing_rest_frame_is_the_median_of_the_least_pressed(tmp_path: Path) -> None:
    pressed = write_folder(tmp_path / "pressed", [1.0] * 9, rest=False, raw=False)
    assert open_recording(pressed).rest_image() is None
    light = write_folder(tmp_path / "light", [0.0] * 9 + [2.0] * 9, rest=False, raw=False)
    recording = open_recording(light)
    rest = recording.rest_image()
    assert rest is not None
    assert "estimated" in " ".join(recording.notes)
    np.testing.assert_allclose(Tracker(rest).rest, Tracker(recording.image(0)).rest, atol=0.1)
    dataset = import_folder(light, tmp_path / "set", read_options([]))
    np.testing.assert_array_equal(dataset.rest, rest)
