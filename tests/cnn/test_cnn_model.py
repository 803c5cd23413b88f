"""The CNN: when it reports a contact, and what it does with the sensor at rest."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from drawn_presses import presses
from silent import Epochs

from tactibench import Contacts, Frame, Grid, ModelContext, Pose


@pytest.fixture(scope="session")
def make_cnn():
    from tactibench_cnn import CNN

    def _make(answer="contacts", **parameters):
        context = ModelContext(answer, Grid.centred(64, 0.4), 6.0)
        return CNN(context, **{"width": 8, "size": 64, "epochs": 2} | parameters)

    return _make


PAPER = {"recipe": "paper"}


def resting(count, seed):
    """Frames that bring the image at rest, 20 grey levels, and noise of their own."""
    rng = np.random.default_rng(seed)
    still = np.full((64, 64), 20, np.uint8)
    noisy = [still + rng.integers(0, 3, still.shape, dtype=np.uint8) for _ in range(count)]
    return still, [Frame(image, 0.0, Pose(), still) for image in noisy]


@pytest.mark.long
def test_a_sensor_at_rest_is_no_contact(make_cnn):
    """Learned from the rest images that the presses bring; none of the frames is at rest."""
    still, empty = resting(50, 3)
    frames, truth = presses(200, 1)
    frames = [Frame(frame.image, 0.0, frame.pose, still) for frame in frames]
    model = make_cnn(epochs=8)
    rng = np.random.default_rng(3)
    model.fit(frames, truth, validation=presses(6, 2), rng=rng, progress=Epochs())
    assert [len(found) for found in model.predict(empty)] == [0] * 50
    assert [len(found) for found in model.predict(presses(50, 8)[0])] == [1] * 50


@pytest.mark.long
def test_training_frames_without_contact_are_learned_from(make_cnn):
    frames, truth = presses(200, 1)
    _, empty = resting(20, 3)
    model = make_cnn(epochs=8)
    report = model.fit(
        [*frames, *empty[:10]],
        [*truth, *[Contacts.none()] * 10],
        validation=presses(6, 2),
        rng=np.random.default_rng(3),
        progress=Epochs(),
    )
    assert "without_contact" not in report.notes
    assert not any(map(len, model.predict(empty[10:])))


def test_the_loss_of_an_answer_that_is_not_there_is_its_presence_alone(make_cnn):
    model = make_cnn()
    outputs = torch.tensor([[9.0, 9.0, 9.0, 0.0], [1.0, 2.0, 3.0, 50.0]])
    targets = torch.tensor([[np.nan] * 3, [1.0, 2.0, 3.0]])
    assert model.loss(outputs, targets).item() == pytest.approx(np.log(2) / 2)
    assert model.loss(outputs[:1], targets[:1]).item() == pytest.approx(np.log(2))


@pytest.mark.parametrize("logit", [-1e4, -1.0, -1e-6, 1e-6, 1.0, 1e4])
def test_a_contact_is_reported_from_an_even_chance_on(make_cnn, logit):
    (found,) = make_cnn().answers(np.array([[0.0, 0.0, 1.0, logit]], np.float32))
    assert len(found) == (logit > 0)


def with_rest(frames, rest):
    return [Frame(frame.image, frame.timestamp, frame.pose, rest) for frame in frames]


@pytest.mark.parametrize(("options", "seen"), [({}, 2), (PAPER, 1)])
def test_the_sensor_at_rest_is_seen_where_every_frame_brings_it(make_cnn, options, seen):
    still, _ = resting(1, 0)
    frames, truth = presses(4, 1)
    model = make_cnn(**options)
    model.prepare(with_rest(frames, still), truth)
    assert model.inputs(frames).shape == (4, seen, 64, 64)
    model.prepare([*with_rest(frames[:3], still), frames[3]], truth)
    assert model.inputs(frames).shape == (4, 1, 64, 64)
