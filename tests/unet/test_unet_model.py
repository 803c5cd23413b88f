import json

import cv2
import numpy as np
import pytest
import torch
from state_hash import state_hash

from tactibench import Contacts, Frame, Grid, ModelContext, PlatePose, UserError


def flat(answers):
    return np.array([[*contacts.xy[0], contacts.depth[0]] for contacts in answers])


def test_only_the_rng_that_is_handed_in_decides_the_weights(make_model, fit, trained):
    with torch.random.fork_rng():
        torch.manual_seed(99)
        before = torch.random.get_rng_state()
        model = make_model()
        fit(model)
        assert torch.equal(before, torch.random.get_rng_state())
    assert state_hash(model.network) == state_hash(trained.network)


def test_another_rng_gives_other_weights(make_model, fit, trained):
    model = make_model(epochs=1)
    fit(model, seed=4)
    assert state_hash(model.network) != state_hash(trained.network)


def test_learning_reduces_the_loss(make_model, fit):
    report = fit(make_model(epochs=4), count=48)
    assert report.history[-1]["loss"] < report.history[0]["loss"]


def test_fit_resumes_from_its_checkpoint(make_model, fit, silent, trained, tmp_path):
    class StopError(Exception):
        pass

    class Stopping(silent):
        def epoch(self, epoch, loss, validation_mm):
            raise StopError

    with pytest.raises(StopError):
        fit(make_model(checkpoints=tmp_path), progress=Stopping())
    model = make_model(checkpoints=tmp_path)
    report = fit(model)
    assert report.resumed_from == 1
    assert state_hash(model.network) == state_hash(trained.network)


def test_saved_weights_give_the_same_maps(make_model, make_presses, trained, tmp_path):
    frames, _ = make_presses(3, 5)
    trained.save(tmp_path)
    other = make_model()
    other.load(tmp_path)
    assert np.array_equal(other.maps(frames), trained.maps(frames))
    assert state_hash(other.network) == state_hash(trained.network)


@pytest.mark.parametrize("other", [{"width": 16}, {"size": 96}, {"stem": 1}, {"answer": "plate"}])
def test_weights_of_another_architecture_are_refused(make_model, trained, tmp_path, other):
    trained.save(tmp_path)
    (name, value), *_ = other.items()
    with pytest.raises(UserError, match=name) as caught:
        make_model(**other).load(tmp_path)
    assert str(value) in str(caught.value)


def test_weights_of_another_model_are_refused(make_model, trained, tmp_path):
    from tactibench.training import save_weights

    save_weights(tmp_path, {}, model="cnn", architecture=trained.architecture)
    with pytest.raises(UserError, match="cnn"):
        make_model().load(tmp_path)


def test_one_frame_at_a_time_answers_like_eight(make_presses, trained):
    frames, _ = make_presses(8, 5)
    together = trained.maps(frames)
    alone = np.concatenate([trained.maps([frame]) for frame in frames])
    np.testing.assert_allclose(alone, together, atol=1e-5)
    np.testing.assert_allclose(
        flat([trained.predict([frame])[0] for frame in frames]),
        flat(trained.predict(frames)),
        atol=1e-3,
    )


def test_predict_folds_batch_norm_without_changing_the_maps(make_presses, trained):
    frames, _ = make_presses(4, 5)
    images = torch.from_numpy(np.stack([frame.image for frame in frames]))[:, None]
    with torch.inference_mode():
        plain = trained.outputs(trained.network(images))
    np.testing.assert_allclose(trained.maps(frames), plain, atol=1e-5)


def test_maps_are_float32_probabilities_of_the_grids_shape(make_presses, trained):
    maps = trained.maps(make_presses(3, 5)[0])
    assert maps.shape == (3, 1, 64, 64)
    assert maps.dtype == np.float32
    assert (maps >= 0).all()
    assert (maps <= 1).all()


def test_the_paper_learns_heat_as_it_is_and_the_default_leaves_the_sigmoid_room(make_model):
    logits, heat = torch.tensor([-2.0, 0.0, 1.0, 4.0]), torch.tensor([0.0, 0.5, 0.7, 1.0])
    paper, default = make_model(recipe="paper"), make_model()
    np.testing.assert_allclose(paper.outputs(logits), logits.sigmoid(), rtol=1e-6)
    published = torch.nn.functional.binary_cross_entropy_with_logits(logits, heat)
    assert paper.loss(logits, heat) == published
    finite = torch.logit(torch.tensor([0.7])).requires_grad_()
    np.testing.assert_allclose(default.outputs(finite.detach()), 1.0, rtol=1e-6)
    default.loss(finite, torch.ones(1)).backward()
    assert abs(float(finite.grad)) < 1e-6
    assert default.outputs(torch.tensor([9.0])) == 1.0


def test_weights_are_read_with_the_headroom_they_were_trained_in(
    make_model, make_presses, trained, tmp_path
):
    trained.save(tmp_path)
    other = make_model(recipe="paper")
    other.load(tmp_path)
    frames, _ = make_presses(2, 5)
    assert np.array_equal(other.maps(frames), trained.maps(frames))


def test_no_frames_give_no_answers(trained):
    assert trained.predict([]) == []
    assert trained.maps([]).shape == (0, 1, 64, 64)


def test_frames_are_not_modified(make_presses, make_model, fit):
    frames, _ = make_presses(24, 1)
    images = [frame.image.copy() for frame in frames]
    model = make_model(epochs=1)
    model.fit(
        frames,
        make_presses(24, 1)[1],
        validation=([], []),
        rng=np.random.default_rng(0),
        progress=_Nothing(),
    )
    model.predict(frames)
    assert all(np.array_equal(frame.image, old) for frame, old in zip(frames, images, strict=True))


class _Nothing:
    def start(self, epochs, steps): ...

    def step(self, loss): ...

    def epoch(self, epoch, loss, validation_mm): ...


def test_frames_of_any_size_and_colour_are_read(make_presses, trained):
    (frame,), _ = make_presses(1, 5)
    colour = Frame(cv2.cvtColor(frame.image, cv2.COLOR_GRAY2RGB), 0.0, frame.pose)
    large = Frame(cv2.resize(frame.image, (200, 200)), 0.0, frame.pose)
    np.testing.assert_allclose(trained.maps([colour]), trained.maps([frame]), atol=0.02)
    assert len(trained.predict([large, frame, colour])) == 3


def test_stages_compose_to_predict(make_presses, trained):
    frames, _ = make_presses(5, 5)
    names = [name for name, _ in trained.stages()]
    assert names == ["preprocess", "forward", "decode"]
    value = frames
    for _, stage in trained.stages():
        value = stage(value)
    assert len(value) == 5
    assert all(isinstance(contacts, Contacts) for contacts in value)
    _, (_, forward), _ = trained.stages()
    images = trained.stages()[0][1](frames)
    np.testing.assert_allclose(forward(images), trained.maps(frames), atol=0.03)  # bf16: 2**-8
    np.testing.assert_allclose(flat(value)[:, 2], flat(trained.predict(frames))[:, 2], atol=0.2)


@pytest.mark.parametrize("size", [64, 96, 128])
@pytest.mark.parametrize("stem", [1, 2])
def test_every_size_and_stem_gives_maps_on_the_grid(make_model, make_presses, size, stem):
    model = make_model(size=size, stem=stem)
    assert model.maps(make_presses(1, 5)[0]).shape == (1, 1, 64, 64)


@pytest.mark.parametrize(
    ("width", "size", "recipe"),
    [(8, 128, "default"), (16, 96, "default"), (32, 64, "default"), (64, 64, "paper")],
)
def test_every_width_and_size_is_trained(make_model, fit, make_presses, width, size, recipe):
    grid = Grid.centred(16, 1.6)
    model = make_model(width=width, size=size, recipe=recipe, epochs=1, grid=grid)
    assert np.isfinite(fit(model, count=2).history[0]["loss"])
    assert len(model.predict(make_presses(1, 5)[0])) == 1


def test_a_grid_that_is_not_square_is_filled(make_model, make_presses):
    model = make_model(grid=Grid((32, 48), (-9.4, -6.2), 0.4))
    assert model.maps(make_presses(2, 5)[0]).shape == (2, 1, 32, 48)


def test_the_default_network_has_four_levels_and_a_bottleneck(make_model):
    """Channels 16, 32, 64, 128, bottleneck 256; 1.9 million weights."""
    model = make_model(width=16)
    assert [block[0].out_channels for block in model.network.down] == [16, 32, 64, 128]
    assert model.network.bottleneck[0].out_channels == 256
    assert model.network.head.kernel_size == (1, 1)
    assert 1.85e6 < model.parameter_count() < 2.0e6


def test_several_contacts_are_learned_from(make_model, make_presses, silent):
    frames, _ = make_presses(8, 1)
    truth = [Contacts.truth([[-4, 0], [4, 0]], [2, 3])] * 7 + [Contacts.none()]
    model = make_model(epochs=1)
    report = model.fit(
        frames,
        truth,
        validation=(frames[:2], truth[-2:]),
        rng=np.random.default_rng(0),
        progress=silent(),
    )
    assert report.epochs == 1


def test_a_plate_is_read_from_the_contact_where_it_touches(make_model, fit, make_presses, tmp_path):
    """Labels from -4 to 1 mm, as a robot's z: the map shows them shifted, answers do not."""
    model = make_model(answer="plate", epochs=40, grid=Grid.centred(32, 0.8))
    report = fit(model, count=48, plate=True)
    frames, truth = make_presses(48, 1, plate=True)
    found = model.predict(frames)
    assert all(isinstance(pose, PlatePose) for pose in found)
    depth = [pose.depth - true.depth for pose, true in zip(found, truth, strict=True)]
    tilt = [pose.tilt - true.tilt for pose, true in zip(found, truth, strict=True)]
    assert np.median(np.abs(depth)) < 0.5
    assert np.median(np.abs(tilt)) < 2.0
    assert report.history[-1]["validation_mm"] < 2.0
    model.save(tmp_path)
    other = make_model(answer="plate", grid=Grid.centred(32, 0.8))
    other.load(tmp_path)
    assert other.predict(frames) == found


def test_plate_labels_that_span_more_than_a_map_are_refused(make_model, make_presses, silent):
    frames, _ = make_presses(2, 1)
    with pytest.raises(UserError, match=r"-4\.00 to 3\.00 mm"):
        make_model(answer="plate").fit(
            frames,
            [PlatePose(-4.0, 0.0), PlatePose(3.0, 0.0)],
            validation=([], []),
            rng=np.random.default_rng(0),
            progress=silent(),
        )


def test_what_cannot_work_is_refused_in_a_sentence(make_model, silent):
    from tactibench_unet.model import UNet

    with pytest.raises(UserError, match="encoder"):
        UNet(ModelContext("contacts", Grid.centred(64, 0.4), 6.0))
    with pytest.raises(UserError, match="multiples of 16"):
        make_model(grid=Grid.centred(60, 0.4))
    with pytest.raises(UserError, match="no training frame"):
        make_model().fit(
            [], [], validation=([], []), rng=np.random.default_rng(0), progress=silent()
        )


def test_the_declaration_fits_the_class_and_imports_nothing_heavy():
    import subprocess
    import sys

    code = (
        "import json, sys; from tactibench_unet import hooks;"
        "(spec,) = hooks.tactibench_models();"
        "heavy = [name for name in ('torch', 'numpy') if name in sys.modules];"
        "print(json.dumps([heavy, spec.settings({}), spec.target]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    heavy, settings, target = json.loads(done.stdout)
    assert heavy == []
    from tactibench_unet.model import UNet

    assert target == "tactibench_unet.model:UNet"
    context = ModelContext("contacts", Grid.centred(64, 0.4), 6.0, encoder=_OneChannel())
    assert UNet(context, **settings).parameter_count() > 0


class _OneChannel:
    channels = 1
