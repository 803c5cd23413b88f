"""The model that states where contacts are and how sure it is."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from state_hash import state_hash

from tactibench import Contacts, Frame, Grid, ModelContext, PlatePose, UserError
from tactibench.training import save_weights


def flat(answers):
    """x, y, depth of every contact of all frames."""
    rows = [np.column_stack([contacts.xy, contacts.depth]) for contacts in answers]
    return np.concatenate([np.empty((0, 3)), *rows])


def test_it_learns_where_and_how_deep_and_says_how_sure_it_is(trained, make_presses):
    history = trained.report.history
    assert history[-1]["loss"] < history[0]["loss"] - 3
    frames, truth = make_presses(50, 8)
    found = trained.predict(frames)
    right = [len(contacts) == 1 for contacts in found]
    assert sum(right) >= 20
    pairs = [(f, t) for f, t, one in zip(found, truth, right, strict=True) if one]
    error = flat([f for f, _ in pairs]) - flat([t for _, t in pairs])
    spread = flat(truth).std(axis=0)
    assert (np.abs(error).mean(axis=0) < spread * [0.1, 0.1, 0.6]).all()
    z = error / np.concatenate([f.std for f, _ in pairs])
    assert np.mean((z[:, :2] ** 2).sum(axis=1) < 5.991) >= 0.7


def test_the_std_are_those_of_the_network_times_the_factors(trained, make_presses):
    frames, _ = make_presses(24, 5)
    factors = trained.report.notes["std_factors"]
    assert np.shape(factors) == (2, 3)
    raw = trained._encoder.decode_batch(trained.evaluate(frames), trained._grid)
    for contacts, plain in zip(trained.predict(frames), raw, strict=True):
        if len(contacts):
            np.testing.assert_allclose(
                contacts.std, plain.std * factors[int(len(plain) > 1)], rtol=1e-3
            )


def test_frames_with_several_contacts_are_learned_from_and_kept_for_the_std(make_mixture, fit):
    report = fit(make_mixture(epochs=1), count=40, most=2)
    assert report.notes["kept_for_std"] == 1


def test_only_the_rng_that_is_handed_in_decides_the_weights(make_mixture, fit, hasty):
    with torch.random.fork_rng():
        torch.manual_seed(99)
        before = torch.random.get_rng_state()
        model = make_mixture()
        fit(model)
        assert torch.equal(before, torch.random.get_rng_state())
    assert state_hash(model.network) == state_hash(hasty.network)
    other = make_mixture()
    fit(other, seed=4)
    assert state_hash(other.network) != state_hash(hasty.network)


def test_fit_resumes_from_its_checkpoint(make_mixture, fit, silent, hasty, tmp_path):
    class StopError(Exception):
        pass

    class Stopping(silent):
        def epoch(self, epoch, loss, validation_mm):
            raise StopError

    with pytest.raises(StopError):
        fit(make_mixture(checkpoints=tmp_path), progress=Stopping())
    model = make_mixture(checkpoints=tmp_path)
    assert fit(model).resumed_from == 1
    assert state_hash(model.network) == state_hash(hasty.network)


def test_saved_weights_give_the_same_answers(make_mixture, make_presses, trained, tmp_path):
    frames, _ = make_presses(3, 5)
    trained.save(tmp_path)
    other = make_mixture()
    other.load(tmp_path)
    for mine, theirs in zip(trained.predict(frames), other.predict(frames), strict=True):
        assert np.array_equal(mine.xy, theirs.xy)
        assert np.array_equal(mine.std, theirs.std)


@pytest.mark.parametrize("other", [{"width": 16}, {"cells": 32}, {"answer": "plate"}])
def test_weights_of_another_architecture_are_refused(make_mixture, hasty, tmp_path, other):
    hasty.save(tmp_path)
    ((name, _),) = other.items()
    with pytest.raises(UserError, match=name):
        make_mixture(**other).load(tmp_path)


def test_weights_of_another_model_are_refused(make_mixture, hasty, tmp_path):
    save_weights(tmp_path, {}, model="unet", architecture=hasty.architecture)
    with pytest.raises(UserError, match="unet"):
        make_mixture().load(tmp_path)


def test_one_frame_at_a_time_answers_like_many(make_presses, trained):
    frames, _ = make_presses(6, 5)
    alone = [trained.predict([frame])[0] for frame in frames]
    np.testing.assert_allclose(flat(alone), flat(trained.predict(frames)), atol=1e-4)


def test_stages_compose_to_predict(make_presses, trained):
    frames, _ = make_presses(5, 5)
    value = frames
    for _, stage in trained.stages():
        value = stage(value)
    assert [name for name, _ in trained.stages()] == ["preprocess", "forward", "decode"]
    np.testing.assert_allclose(flat(value), flat(trained.predict(frames)), atol=0.3)  # bf16


def test_no_frames_give_no_answers(trained):
    assert trained.predict([]) == []


def test_an_untouched_frame_has_an_answer_of_some_kind(trained, draw):
    press, _, _ = draw
    (found,) = trained.predict([press(Contacts.none())])
    assert isinstance(found, Contacts)


def test_frames_of_any_size_and_colour_are_read_and_left_alone(make_presses, trained):
    (frame,), _ = make_presses(1, 5)
    before = frame.image.copy()
    colour = Frame(cv2.cvtColor(frame.image, cv2.COLOR_GRAY2RGB), 0.0, frame.pose)
    large = Frame(cv2.resize(frame.image, (200, 200)), 0.0, frame.pose)
    found = trained.predict([frame, colour, large])
    assert [len(contacts) for contacts in found] == [1, 1, 1]
    np.testing.assert_allclose(flat(found[1:2]), flat(found[:1]), atol=0.05)
    assert np.array_equal(frame.image, before)


def test_plates_are_learned_with_labels_of_any_sign(make_mixture, fit, make_presses):
    model = make_mixture(answer="plate", epochs=25)
    fit(model, count=128, plate=True)
    frames, truth = make_presses(30, 8, plate=True)
    pairs = [(p, t) for p, t in zip(model.predict(frames), truth, strict=True) if p is not None]
    assert len(pairs) >= 15
    assert all(isinstance(pose, PlatePose) for pose, _ in pairs)
    assert np.mean([abs(pose.depth - true.depth) for pose, true in pairs]) < 0.8
    assert np.mean([abs(pose.tilt - true.tilt) for pose, true in pairs]) < 2.5


def test_a_model_without_training_knows_no_pins(make_mixture, make_presses):
    with pytest.raises(UserError, match="train it"):
        make_mixture().predict(make_presses(1, 5)[0])


def test_frames_without_a_rest_image_take_the_least_pressed(make_mixture, make_presses, draw):
    press, _, _ = draw
    frames, truth = make_presses(8, 5)
    still = press(Contacts.none())
    frames = [replace(frame, rest=None) for frame in [*frames[:4], still, *frames[4:]]]
    model = make_mixture()
    model.prepare(frames, [*truth[:4], Contacts.none(), *truth[4:]])
    assert model.inputs([still]).abs().max() < 0.02
    assert model.inputs(frames[:1]).abs().max() > 0.1


def test_training_without_frames_is_refused(make_mixture, silent):
    with pytest.raises(UserError, match="no training frame"):
        make_mixture().fit(
            [], [], validation=([], []), rng=np.random.default_rng(0), progress=silent()
        )


def test_an_encoder_of_another_kind_is_refused(make_mixture):
    class Heat:
        channels = 1

    with pytest.raises(UserError, match="kind mixture"):
        make_mixture(encoder=Heat())


def test_a_grid_that_its_cells_do_not_divide_is_refused(make_mixture):
    with pytest.raises(UserError, match="multiple of 16"):
        make_mixture(grid=Grid.centred(60, 0.4))


def test_the_declaration_fits_the_class_and_imports_nothing_heavy(make_mixture):
    code = (
        "import json, sys; from tactibench_mixture import hooks;"
        "(spec,) = hooks.tactibench_models();"
        "heavy = [name for name in ('torch', 'numpy') if name in sys.modules];"
        "print(json.dumps([heavy, spec.settings({}), spec.target, spec.encoders]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    heavy, settings, target, encoders = json.loads(done.stdout)
    assert heavy == []
    assert encoders == ["mixture"]
    assert target == "tactibench_mixture.model:Mixture"
    encoder = make_mixture()._encoder
    context = ModelContext("contacts", Grid.centred(64, 0.4), 6.0, encoder)
    assert type(make_mixture())(context, **settings).parameter_count() > 0
