"""Raw pictures of a camera, and recordings without a frame of the undeformed sensor."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import Any

import cv2
import drawn_pins
import numpy as np
import numpy.typing as npt
import pytest
from raw_camera import LEFT, SIDE, TOP, discs, raw_discs, raw_frame

from tactibench import SensorContext, UserError
from tactibench.datasets import import_folder, open_recording, read_options
from tactibench.markers import Tracker, choose_light, count_pins, find_pin_view
from tactibench_recorded.sensor import RecordedSensor

Array = npt.NDArray[np.float64]

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
    view, chosen = choose_light([raw])
    assert view is not None
    assert chosen.startswith("even: ")
    seen = view.of(raw)
    assert seen.shape == (view.size, view.size)
    found = (Tracker(seen).rest + 0.5) * view.side / view.size - 0.5 + (view.left, view.top)
    scale = SIDE / drawn_pins.SIZE
    truth = (pins + 0.5) * scale - 0.5 + (LEFT, TOP)
    apart = np.linalg.norm(found[:, None] - truth, axis=2)
    assert apart.min(axis=1).max() < 1.0  # nothing else is taken for a pin
    assert (apart.min(axis=0) < 1.0).mean() > 0.9  # a reflection may lie on a pin


def pushed_away(pins: Array, at: tuple[float, float]) -> Array:
    away = pins - at
    return pins + 0.15 * away * np.exp(-(away**2).sum(axis=1, keepdims=True) / (2 * 60.0**2))


CLEAN = [(2, 11, 330), (3, 12, 360), (6, 16, 480), (6, 20, 512), (9, 30, 700)]
"""Radius and pitch of discs, and side of the frame, px."""


@pytest.mark.parametrize("levels", [(0, 255), (255, 0)], ids=["bright", "dark"])
@pytest.mark.parametrize(("radius", "pitch", "side"), CLEAN)
def test_frames_made_for_pins_stay_as_they_are(
    radius: float, pitch: float, side: int, levels: tuple[int, int]
) -> None:
    """Corners of large discs are spots of one size, too: six times as many."""
    rest = drawn_pins.hexagon(6, pitch, side / 2)
    ground, pin = levels
    frames = [
        np.where(discs(pins, radius, (side, side)) > 0.5, pin, ground).astype(np.uint8)
        for pins in (rest, pushed_away(rest, (0.4 * side, 0.6 * side)))
    ]
    view, chosen = choose_light(frames)
    if pin > ground:
        assert view is None
        assert chosen == "as_is: 127 regular pins, 127 in even light"
    else:  # pins are bright where they are followed
        assert view is not None
        assert count_pins(view.of(frames[0])) == 127


RAW = {
    "bright surround": {"ground": 40.0, "pin": 110.0},
    "pins on mid grey": {"ground": 90.0, "pin": 110.0},
    "dark surround, no lamps": {"ground": 60.0, "pin": 110.0, "surround": (20.0, 20.0), "lamps": 0},
    "pins as bright as the surround": {"ground": 130.0, "pin": 200.0},
    "dark pins on bright": {"ground": 165.0, "pin": 110.0, "lamps": 4},
}
SMALL, LARGE = (3, 13, 8), (6, 24, 6)
"""Radius and pitch of discs, px, and their rings."""


@pytest.mark.parametrize(
    ("look", "radius", "pitch", "rings"),
    [
        *((look, *size) for look, size in zip(RAW.values(), cycle([SMALL, LARGE]))),
        *(
            pytest.param(look, *size, marks=pytest.mark.long)
            for look, size in zip(RAW.values(), cycle([LARGE, SMALL]))
        ),
    ],
)
def test_pins_of_raw_pictures_are_found_in_even_light(
    look: dict[str, Any], radius: float, pitch: float, rings: int
) -> None:
    rng = np.random.default_rng(2)
    rest = drawn_pins.hexagon(rings, pitch, 0.0) + np.array([320.0, 240.0])
    frames = [raw_discs(p, radius, rng, **look) for p in (rest, pushed_away(rest, (290, 260)))]
    view, chosen = choose_light(frames)
    assert view is not None, chosen
    found = (Tracker(view.of(frames[0]), refine=False).rest + 0.5) * view.side / view.size - 0.5
    apart = np.linalg.norm(found[:, None] + (view.left, view.top) - rest, axis=2)
    assert (apart.min(axis=0) < 1.5).mean() > 0.85  # lamps lie on some
    assert (apart.min(axis=1) < 1.5).mean() > 0.95  # or leave a rest beside one


def test_noise_is_neither_raw_nor_followed() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (480, 640), dtype=np.uint8)
    view, chosen = choose_light([noise])
    assert view is None
    assert "no regular set of pins" in chosen
    with pytest.raises(UserError, match="light=as_is"):
        find_pin_view(noise)
    with pytest.raises(UserError, match="light=even"):
        count_pins(noise)


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
    context = SensorContext(np.random.SeedSequence(0), folder)
    assert "cut_out" in RecordedSensor(context).describe()  # a run takes the light, too
    assert RecordedSensor(context, light="as_is").describe()["image"] == [480, 640]
    with pytest.raises(UserError, match="leave light out"):
        open_recording(dataset.folder, read_options(["light=even"]))


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
