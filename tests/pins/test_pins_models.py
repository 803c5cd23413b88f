"""Both models: what they learn, refuse, keep and say of themselves."""

from dataclasses import replace

import numpy as np
import pytest

from tactibench import Contacts, UserError
from tactibench_pins import contact_threshold, read_answers, rms_displacement

NAMES = ("kernel", "pins")
FAR = {"kernel": 0.1, "pins": 0.35}
"""Error beside that of the mean answer: networks need more presses than a test can make."""
both = pytest.mark.parametrize("name", NAMES)


def poses(answers):
    return np.array([[pose.depth, pose.tilt] for pose in answers])


@pytest.mark.long
@both
def test_plates_are_read_far_better_than_by_their_mean(taught, make_presses, name):
    frames, truth = make_presses(60, 7)
    answers = poses(taught[name][0].predict(frames))
    error = np.abs(answers - poses(truth)).mean(axis=0)
    alone = np.abs(poses(truth) - poses(truth).mean(axis=0)).mean(axis=0)
    assert (error < FAR[name] * alone).all(), error / alone


@pytest.mark.long
@both
def test_single_contacts_are_read_too(make_model, fit, make_presses, name):
    model = make_model(name, answer="contacts")
    fit(model, plate=False, count=200)
    frames, truth = make_presses(40, 8, plate=False)
    answers = model.predict(frames)
    assert all(len(contacts) == 1 for contacts in answers)
    apart = [np.linalg.norm(f.xy[0] - t.xy[0]) for f, t in zip(answers, truth, strict=True)]
    assert np.mean(apart) < 1.0


@both
def test_a_sensor_at_rest_is_no_contact(make_model, fit, make_presses, name, tmp_path):
    """No training frame is at rest: the faintest press says how far pins go at least."""
    model = make_model(name, answer="contacts", **({"epochs": 20} if name == "pins" else {}))
    fit(model, plate=False, count=60)
    frames, _ = make_presses(20, 8, plate=False)
    rng = np.random.default_rng(1)
    still = [
        replace(frame, signal=frame.rest + rng.integers(0, 3, frame.rest.shape, dtype=np.uint8))
        for frame in frames
    ]
    model.save(tmp_path)
    again = make_model(name, answer="contacts", **({"epochs": 20} if name == "pins" else {}))
    again.load(tmp_path)
    for learned in (model, again):
        assert [len(contacts) for contacts in learned.predict(still)] == [0] * 20
        assert [len(contacts) for contacts in learned.predict(frames)] == [1] * 20


def test_how_far_pins_went_decides():
    values = np.array([[1.0, 2.0, 3.0, far] for far in (0.0, 0.49, 0.5, 2.0)])
    assert [len(contacts) for contacts in read_answers(values, "contacts", 0.5)] == [0, 0, 1, 1]
    assert [pose.tilt for pose in read_answers(values[:, 1:], "plate", 0.0)] == [3.0] * 4
    moved = np.repeat([[1.0], [2.0], [4.0]], 6, axis=1)
    np.testing.assert_allclose(rms_displacement(moved), [1.0, 2.0, 4.0])
    assert 0.5 <= contact_threshold(moved, "contacts") < 0.52
    assert contact_threshold(moved, "plate") == 0.0


@pytest.mark.long
@both
def test_no_frame_is_dropped_and_missing_pins_are_predicted(taught, make_presses, name):
    (frame,), (true,) = make_presses(1, 11)
    image = frame.image.copy()
    image[28:38, 28:38] = 10  # a pin or two are gone
    (pose,) = taught[name][0].predict([replace(frame, signal=image)])
    assert abs(pose.depth - true.depth) < 1.0
    (blank,) = taught[name][0].predict([replace(frame, signal=np.zeros_like(image))])
    assert np.isfinite([blank.depth, blank.tilt]).all()


@both
def test_several_contacts_and_no_contact(make_model, make_presses, fit, name):
    frames, truth = make_presses(4, 13, plate=False)
    two = Contacts.truth([[0, 0], [3, 0]], [1, 1])

    def learn(answers):
        model = (
            make_model(name, answer="contacts", epochs=1)
            if name == "pins"
            else make_model(name, answer="contacts")
        )
        rng = np.random.default_rng(0)
        progress = type("P", (), {m: lambda *_: None for m in ("start", "step", "epoch")})()
        return model.fit(frames, answers, validation=([], []), rng=rng, progress=progress)

    with pytest.raises(UserError, match=f"model '{name}' answers one contact, but .* holds 2"):
        learn([*truth[:3], two])
    assert 1 in learn([*truth[:3], Contacts.none()]).notes.values()
    with pytest.raises(UserError, match="raise the training count"):
        learn([Contacts.none()] * 4)


@pytest.mark.long
@both
def test_without_a_rest_image_the_least_pressed_frame_stands_in(
    make_model, fit, make_presses, name
):
    model = make_model(name)
    fit(model, rest=False)
    frames, truth = make_presses(30, 15, rest=False)
    error = np.abs(poses(model.predict(frames)) - poses(truth)).mean(axis=0)
    assert (error < [0.5, 3.0]).all()


@pytest.mark.long
def test_members_differ_and_their_mean_is_the_answer(taught, make_presses):
    import torch

    model = taught["pins"][0]
    frames, _ = make_presses(5, 17)
    with torch.no_grad():
        raw = model.network(model.inputs(frames))
    assert raw.shape == (5, 2, 3)
    assert float((raw[:, 0, :2] - raw[:, 1, :2]).abs().max()) > 1e-4
    assert (raw[:, 0, 2] == raw[:, 1, 2]).all()
    np.testing.assert_allclose(model.outputs(raw)[:, :2], poses(model.predict(frames)), atol=1e-5)
