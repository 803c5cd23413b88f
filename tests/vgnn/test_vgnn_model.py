from dataclasses import replace

import numpy as np
import pytest

from tactibench import Contacts


def flat(answers):
    return np.array(
        [[*contacts.xy[0], contacts.depth[0], *contacts.std[0]] for contacts in answers]
    )


@pytest.fixture(scope="module")
def taught(make_vgnn, fit):
    model = make_vgnn(epochs=24)
    return model, *fit(model, count=200)


@pytest.mark.long
def test_it_learns_where_and_how_deep_and_how_sure_it_is(taught, make_presses):
    model, report, progress = taught
    assert report.history[-1]["loss"] < report.history[0]["loss"] - 3
    assert progress.epochs[-1][2] < 0.4
    frames, truth = make_presses(60, 8)
    found = model.predict(frames)
    assert all(len(contacts) >= 1 for contacts in found)
    true = np.array([[*contacts.xy[0], contacts.depth[0]] for contacts in truth])
    got = flat(found)
    error = got[:, :3] - true
    assert (np.median(np.abs(error), axis=0) < [0.3, 0.3, 1.0]).all()
    z = np.median(np.abs(error / got[:, 3:]), axis=0)
    assert ((z > 0.05) & (z < 2)).all()


@pytest.mark.long
def test_the_sensor_at_rest_has_no_contact(taught, rest_frame):
    assert len(taught[0].predict([rest_frame])[0]) == 0


@pytest.mark.long
def test_missing_pins_drop_no_frame(taught, rest_pins, push_pins, draw_pins, make_presses):
    (frame,), (true,) = make_presses(1, 8)
    xy = push_pins(*true.xy[0], true.depth[0])
    lost = np.delete(xy, [2, 20, 33], axis=0)
    (found,) = taught[0].predict([replace(frame, signal=draw_pins(lost))])
    assert len(found) >= 1
    assert np.linalg.norm(found.xy[0] - true.xy[0]) < 3.0


@pytest.mark.long
def test_mixed_frames_are_learned_from_and_scale_the_std(make_vgnn, fit):
    report, _ = fit(make_vgnn(mixing=0.25, epochs=1), count=64)
    assert report.notes["mixed"] == round(0.25 * (64 + 2))  # two of the sensor at rest


def test_frames_without_a_rest_image_take_the_least_pressed(make_vgnn, make_presses, rest_frame):
    frames, truth = make_presses(32, 5)
    frames = [replace(frame, rest=None) for frame in [*frames, rest_frame]]
    model = make_vgnn()
    model.prepare(frames, [*truth, Contacts.none()])
    assert model.inputs([frames[-1]])[..., :4].abs().max() < 1e-6
