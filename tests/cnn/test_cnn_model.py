import json
import subprocess
import sys

import cv2
import numpy as np
import pytest
import torch
from state_hash import state_hash

from tactibench import Contacts, Frame, Grid, ModelContext, PlatePose, Pose, UserError
from tactibench.training import save_weights


def flat(answers):
    return np.array([[*contacts.xy[0], contacts.depth[0]] for contacts in answers])


def test_only_the_rng_that_is_handed_in_decides_the_weights(make_cnn, fit, trained):
    with torch.random.fork_rng():
        torch.manual_seed(99)
        before = torch.random.get_rng_state()
        model = make_cnn()
        fit(model)
        assert torch.equal(before, torch.random.get_rng_state())
    assert state_hash(model.network) == state_hash(trained.network)
    other = make_cnn()
    fit(other, seed=4)
    assert state_hash(other.network) != state_hash(trained.network)


def test_it_learns_where_and_how_deep(make_cnn, fit, make_presses, silent):
    progress = silent()
    model = make_cnn(epochs=8)
    report = fit(model, count=200, progress=progress)
    assert report.history[-1]["loss"] < 0.2 * report.history[0]["loss"]
    assert progress.epochs[-1][2] < 0.5 * progress.epochs[0][2]
    frames, truth = make_presses(50, 8)
    error = np.abs(flat(model.predict(frames)) - flat(truth)).mean(axis=0)
    spread = np.abs(flat(truth) - flat(truth).mean(axis=0)).mean(axis=0)
    assert (error < 0.25 * spread).all()


def test_without_a_frame_at_rest_every_answer_is_a_contact(make_presses, trained):
    for contacts in trained.predict(make_presses(5, 8)[0]):
        assert len(contacts) == 1
        assert contacts.score[0] > 0.8


def resting(count, seed):
    """Frames that bring the image at rest, 20 grey levels, and noise of their own."""
    rng = np.random.default_rng(seed)
    still = np.full((64, 64), 20, np.uint8)
    noisy = [still + rng.integers(0, 3, still.shape, dtype=np.uint8) for _ in range(count)]
    return still, [Frame(image, 0.0, Pose(), still) for image in noisy]


def test_a_sensor_at_rest_is_no_contact(make_cnn, make_presses, silent):
    """Learned from the rest images that the presses bring; none of the frames is at rest."""
    still, empty = resting(50, 3)
    frames, truth = make_presses(200, 1)
    frames = [Frame(frame.image, 0.0, frame.pose, still) for frame in frames]
    model = make_cnn(epochs=8)
    rng = np.random.default_rng(3)
    model.fit(frames, truth, validation=make_presses(6, 2), rng=rng, progress=silent())
    assert [len(found) for found in model.predict(empty)] == [0] * 50
    assert [len(found) for found in model.predict(make_presses(50, 8)[0])] == [1] * 50


def test_training_frames_without_contact_are_learned_from(make_cnn, make_presses, silent):
    frames, truth = make_presses(200, 1)
    _, empty = resting(20, 3)
    model = make_cnn(epochs=8)
    report = model.fit(
        [*frames, *empty[:10]],
        [*truth, *[Contacts.none()] * 10],
        validation=make_presses(6, 2),
        rng=np.random.default_rng(3),
        progress=silent(),
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


def test_fit_resumes_from_its_checkpoint(make_cnn, fit, silent, trained, tmp_path):
    class StopError(Exception):
        pass

    class Stopping(silent):
        def epoch(self, epoch, loss, validation_mm):
            raise StopError

    with pytest.raises(StopError):
        fit(make_cnn(checkpoints=tmp_path), progress=Stopping())
    model = make_cnn(checkpoints=tmp_path)
    assert fit(model).resumed_from == 1
    assert state_hash(model.network) == state_hash(trained.network)


def test_saved_weights_give_the_same_answers(make_cnn, make_presses, trained, tmp_path):
    frames, _ = make_presses(3, 5)
    trained.save(tmp_path)
    other = make_cnn()
    other.load(tmp_path)
    assert np.array_equal(flat(other.predict(frames)), flat(trained.predict(frames)))


@pytest.mark.parametrize("other", [{"width": 16}, {"size": 96}, {"answer": "plate"}])
def test_weights_of_another_architecture_are_refused(make_cnn, trained, tmp_path, other):
    trained.save(tmp_path)
    ((name, _),) = other.items()
    with pytest.raises(UserError, match=name):
        make_cnn(**other).load(tmp_path)


def test_weights_of_another_model_are_refused(make_cnn, trained, tmp_path):
    save_weights(tmp_path, {}, model="unet", architecture=trained.architecture)
    with pytest.raises(UserError, match="unet"):
        make_cnn().load(tmp_path)


def test_one_frame_at_a_time_answers_like_eight(make_presses, trained):
    frames, _ = make_presses(8, 5)
    alone = [trained.predict([frame])[0] for frame in frames]
    np.testing.assert_allclose(flat(alone), flat(trained.predict(frames)), atol=1e-4)


def test_predict_folds_batch_norm_without_changing_the_answer(make_presses, trained):
    frames, _ = make_presses(4, 5)
    images = torch.from_numpy(np.stack([frame.image for frame in frames]))[:, None]
    with torch.inference_mode():
        normal = trained.network(images).numpy()
    expected = trained.stages()[-1][1](normal)
    np.testing.assert_allclose(flat(trained.predict(frames)), flat(expected), atol=1e-4)


def test_stages_compose_to_predict(make_presses, trained):
    frames, _ = make_presses(5, 5)
    value = frames
    for _, stage in trained.stages():
        value = stage(value)
    assert [name for name, _ in trained.stages()] == ["preprocess", "forward", "decode"]
    np.testing.assert_allclose(flat(value), flat(trained.predict(frames)), atol=0.1)  # bf16


def test_no_frames_give_no_answers(trained):
    assert trained.predict([]) == []


def test_frames_of_any_size_and_colour_are_read_and_left_alone(make_presses, trained):
    (frame,), _ = make_presses(1, 5)
    before = frame.image.copy()
    colour = Frame(cv2.cvtColor(frame.image, cv2.COLOR_GRAY2RGB), 0.0, frame.pose)
    large = Frame(cv2.resize(frame.image, (200, 200)), 0.0, frame.pose)
    found = flat(trained.predict([frame, colour, large]))
    np.testing.assert_allclose(found[1], found[0], atol=0.05)
    assert np.array_equal(frame.image, before)


@pytest.mark.parametrize(("width", "size"), [(8, 128), (16, 96), (32, 64), (64, 64)])
def test_every_width_and_size_is_trained(make_cnn, fit, make_presses, width, size):
    model = make_cnn(width=width, size=size, epochs=1)
    assert np.isfinite(fit(model, count=2).history[0]["loss"])
    assert len(model.predict(make_presses(2, 5)[0])) == 2


def test_plates_are_regressed_with_labels_of_any_sign(make_cnn, fit, make_presses, silent):
    progress = silent()
    model = make_cnn(answer="plate", epochs=8)
    fit(model, count=200, plate=True, progress=progress)
    frames, truth = make_presses(50, 8, plate=True)
    found = model.predict(frames)
    assert all(isinstance(pose, PlatePose) for pose in found)
    assert np.mean([abs(p.depth - t.depth) for p, t in zip(found, truth, strict=True)]) < 0.4
    assert np.mean([abs(p.tilt - t.tilt) for p, t in zip(found, truth, strict=True)]) < 2.0
    assert 0 < progress.epochs[-1][2] < 1.0


def learn(model, frames, truth, progress):
    rng = np.random.default_rng(0)
    return model.fit(frames, truth, validation=([], []), rng=rng, progress=progress)


def test_a_frame_with_several_contacts_is_refused(make_cnn, make_presses, silent):
    frames, truth = make_presses(4, 5)
    truth[2] = Contacts.truth([[0, 0], [5, 0]], [1, 1])
    with pytest.raises(UserError, match="holds 2"):
        learn(make_cnn(), frames, truth, silent())


def test_training_frames_without_any_contact_are_refused(make_cnn, make_presses, silent):
    frames, _ = make_presses(3, 5)
    truth = [Contacts.none()] * 3
    with pytest.raises(UserError, match="no training frame"):
        learn(make_cnn(), frames, truth, silent())


def test_training_without_frames_is_refused(make_cnn, silent):
    with pytest.raises(UserError, match="no training frame"):
        learn(make_cnn(), [], [], silent())


def test_the_declaration_fits_the_class_and_imports_nothing_heavy():
    code = (
        "import json, sys; from tactibench_cnn import hooks;"
        "(spec,) = hooks.tactibench_models();"
        "heavy = [name for name in ('torch', 'numpy') if name in sys.modules];"
        "print(json.dumps([heavy, spec.settings({}), spec.target, spec.max_contacts]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    heavy, settings, target, most = json.loads(done.stdout)
    assert heavy == []
    assert most == 1
    from tactibench_cnn.model import CNN

    assert target == "tactibench_cnn.model:CNN"
    model = CNN(ModelContext("contacts", Grid.centred(64, 0.4), 6.0), **settings)
    assert model.parameter_count() > 0
