"""The fitted simulated sensor: where the pins go, what is drawn, what is refused."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from tac_vgnn import tac_vgnn_folder

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench.datasets import direction_of, open_recording
from tactibench.markers import Tracker
from tactibench_sim import Fitted127, Fitted331, calibration_of


def made(kind=Fitted127, seed=0, **parameters):
    return kind(SensorContext(np.random.SeedSequence(seed)), **{"size": 128} | parameters)


def plate(depth=3.0, tilt=0.0, yaw=90.0):
    return Scene(Indenter.plate(), Pose(yaw=yaw, tilt=tilt, depth=depth))


@pytest.mark.parametrize(("kind", "pins"), [(Fitted127, 127), (Fitted331, 331)])
def test_the_rest_frame_shows_all_pins_where_they_are(kind, pins):
    sensor = made(kind, size=256)
    rest = Tracker(sensor.rest().image, refine=False).rest
    assert len(rest) == pins
    apart = np.linalg.norm(rest[:, None] - sensor.rig.rest, axis=2).min(axis=1)
    assert apart.max() < 0.2  # the discs are hardly wider than a pixel


@pytest.mark.parametrize("yaw", [90.0, 0.0, -60.0])
def test_the_contact_is_found_where_the_tilt_moves_it(yaw):
    """As `tactibench data fit` finds it in a recording."""
    sensor = made(drag=0.0)
    tilt = np.linspace(-20, 20, 21)
    moved = sensor.moved([plate(3.0, t, yaw) for t in tilt])
    found, _ = direction_of(-moved.mean(axis=1), tilt)
    assert (found - yaw + 180) % 360 - 180 == pytest.approx(0, abs=1.5)  # the camera's roll


def test_the_drag_is_a_shift_along_the_tilt_that_some_presses_have():
    still, dragged = made(drag=0.0), made(drag=5.0, dragged=0.5)
    scenes = [plate()] * 300
    shift = (dragged.moved(scenes) - still.moved(scenes)).mean(axis=1)
    along = shift[:, 1]
    assert np.abs(shift[:, 0]).max() < 0.05 * np.abs(along).max()
    had = np.abs(along) > 1e-9
    assert had.mean() == pytest.approx(0.5, abs=0.1)
    assert along.min() < -0.5
    assert along.max() > 0.5


def test_tips_press_where_they_are_and_between_plates():
    """x right, y down; a press by a tip moves the pins around it, and plates beside it do not."""
    tip = Scene(Indenter.single(), Pose(x=4.0, y=-3.0, depth=3.0))
    with made() as alone, made() as mixed:
        frame = alone.press(tip).image
        first, middle, _ = mixed.press_many([tip, plate(), tip])
    np.testing.assert_array_equal(first.image, frame)
    assert not np.array_equal(middle.image, frame)
    sensor = made()
    seen = np.stack(sensor.renderer.project(sensor.points([tip]))[:2], axis=-1)[0]
    moved = np.linalg.norm(seen - sensor.rig.rest, axis=1)
    x, y = sensor.rig.rest[np.argmax(moved)] - sensor.rig.rest.mean(axis=0)
    assert 3 < x < 8
    assert -6 < y < -1.5


def test_individuals_differ_in_the_field_and_share_the_rest_frame():
    nominal, some = made(drag=0.0), made(drag=0.0, spread=1.0, individuals=4)
    np.testing.assert_array_equal(nominal.rest().image, some.rest().image)
    found = some.moved([plate(4.0, 10.0)] * 60)
    kinds = np.unique(found.round(9), axis=0)
    assert len(kinds) == 4
    assert (np.abs(kinds - nominal.moved([plate(4.0, 10.0)])).max(axis=(1, 2)) < 1e-9).sum() == 1


def test_the_frames_it_was_fitted_to_are_told():
    ((recording, frames),) = made().calibrated_on().items()
    assert len(frames) == len(set(frames)) == 400
    assert recording == calibration_of(127).recording
    opened = open_recording(tac_vgnn_folder("127"))
    assert opened.sha256 == recording
    assert set(frames) <= set(opened.names)


def test_a_calibration_of_ones_own(tmp_path):
    path, shipped = tmp_path / "own.json", dataclasses.asdict(calibration_of(331))
    path.write_text(json.dumps(shipped | {"kind": "50_stick"}))
    assert made(calibration=str(path)).describe()["calibration"]["kind"] == "50_stick"
    path.write_text(json.dumps(shipped | {"kind": "7_stick"}))
    with pytest.raises(UserError, match="7_stick"):
        made(calibration=str(path))
    for text in ("{}", "no json", "[]", '{"rest_centre": 3}'):
        path.write_text(text)
        with pytest.raises(UserError, match="no calibration"):
            made(calibration=str(path))
    with pytest.raises(UserError, match="no calibration"):
        made(calibration=str(tmp_path / "absent.json"))


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (Scene(Indenter.single(), Pose(depth=9.0)), "tables end"),
        (Scene(Indenter.single(7.0), Pose(depth=2.0)), "radius"),
        (plate(6.5), "from 0 to 6.25"),
        (plate(-0.1), "0 or more"),
        (plate(2.0, 50.0), "within"),
        (plate(float("nan")), "finite"),
    ],
)
def test_what_cannot_be_pressed_is_refused(scene, said):
    with made() as sensor, pytest.raises(UserError, match=said):
        sensor.press(scene)
