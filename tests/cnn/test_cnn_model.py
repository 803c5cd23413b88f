import numpy as np
import pytest
import torch
from drawn_presses import fit, presses
from silent import Epochs

from tactibench import Contacts, Frame, PlatePose, Pose, UserError

PAPER = {"recipe": "paper"}


def flat(answers):
    return np.array([[*contacts.xy[0], contacts.depth[0]] for contacts in answers])


@pytest.mark.long
def test_it_learns_where_and_how_deep(make_cnn):
    progress = Epochs()
    model = make_cnn(epochs=8)
    report = fit(model, count=200, progress=progress)
    assert report.history[-1]["loss"] < 0.2 * report.history[0]["loss"]
    assert progress.epochs[-1][2] < 0.5 * progress.epochs[0][2]
    frames, truth = presses(50, 8)
    error = np.abs(flat(model.predict(frames)) - flat(truth)).mean(axis=0)
    spread = np.abs(flat(truth) - flat(truth).mean(axis=0)).mean(axis=0)
    assert (error < 0.25 * spread).all()


def test_without_a_frame_at_rest_every_answer_is_a_contact(trained):
    for contacts in trained.predict(presses(5, 8)[0]):
        assert len(contacts) == 1
        assert contacts.score[0] > 0.8


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


@pytest.mark.parametrize(("width", "size"), [(8, 128), (16, 96), (32, 64), (64, 64)])
def test_every_width_and_size_is_trained(make_cnn, width, size):
    model = make_cnn(width=width, size=size, epochs=1)
    assert np.isfinite(fit(model, count=2).history[0]["loss"])
    assert len(model.predict(presses(2, 5)[0])) == 2


@pytest.mark.long
def test_plates_are_regressed_with_labels_of_any_sign(make_cnn):
    progress = Epochs()
    model = make_cnn(answer="plate", epochs=8)
    fit(model, count=200, plate=True, progress=progress)
    frames, truth = presses(50, 8, plate=True)
    found = model.predict(frames)
    assert all(isinstance(pose, PlatePose) for pose in found)
    assert np.mean([abs(p.depth - t.depth) for p, t in zip(found, truth, strict=True)]) < 0.4
    assert np.mean([abs(p.tilt - t.tilt) for p, t in zip(found, truth, strict=True)]) < 2.0
    assert 0 < progress.epochs[-1][2] < 1.0


def learn(model, frames, truth, progress):
    rng = np.random.default_rng(0)
    return model.fit(frames, truth, validation=([], []), rng=rng, progress=progress)


def test_a_frame_with_several_contacts_is_refused(make_cnn):
    frames, truth = presses(4, 5)
    truth[2] = Contacts.truth([[0, 0], [5, 0]], [1, 1])
    with pytest.raises(UserError, match="holds 2"):
        learn(make_cnn(), frames, truth, Epochs())


def test_training_frames_without_any_contact_are_refused(make_cnn):
    frames, _ = presses(3, 5)
    truth = [Contacts.none()] * 3
    with pytest.raises(UserError, match="no training frame"):
        learn(make_cnn(), frames, truth, Epochs())


def with_rest(frames, rest):
    return [Frame(frame.image, frame.timestamp, frame.pose, rest) for frame in frames]


@pytest.mark.parametrize(("options", "seen"), [({}, 2), ({"rest": "never"}, 1), (PAPER, 1)])
def test_the_sensor_at_rest_is_seen_where_every_frame_brings_it(make_cnn, options, seen):
    still, _ = resting(1, 0)
    frames, truth = presses(4, 1)
    model = make_cnn(**options)
    model.prepare(with_rest(frames, still), truth)
    assert model.inputs(frames).shape == (4, seen, 64, 64)
    model.prepare([*with_rest(frames[:3], still), frames[3]], truth)
    assert model.inputs(frames).shape == (4, 1, 64, 64)


def test_less_light_is_undone_by_the_rest_frame(make_cnn):
    """The whole frame, as a lamp that fades dims it."""
    still, _ = resting(1, 0)
    frames, truth = presses(40, 1)
    model = make_cnn(epochs=1)
    rng = np.random.default_rng(3)
    model.fit(with_rest(frames, still), truth, validation=([], []), rng=rng, progress=Epochs())
    dim = [Frame(frame.image // 2, 0.0, frame.pose, still) for frame in frames]
    bright = flat(model.predict(with_rest(frames, still)))
    # Halving bytes loses half a level, which an untrained network may take for .1 mm.
    np.testing.assert_allclose(flat(model.predict(dim)), bright, atol=0.2)
