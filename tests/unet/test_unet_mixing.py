"""The U-Net mixes by its recipe, counts by held-out frames, and is trained under faults."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from drawn_presses import presses
from silent import Epochs

import tactibench.superposition
from tactibench import Contacts, Grid, UserError
from tactibench_unet import UNetNetwork, disturb, least_share


@pytest.fixture
def mixed(monkeypatch):
    """Replace mixing by two contacts of one spot; returns what it was asked for."""
    asked = []

    def mix(frames, truth, count, rng, law=None, misfit=0.0):
        asked.append((len(truth), count, law, misfit))
        pair = Contacts.truth([[-4.0, 0.0], [4.0, 0.0]], [2.0, 3.0])
        return [frames[0]] * count, [pair] * count

    monkeypatch.setattr(tactibench.superposition, "mix", mix)
    return asked


def fit(model, count=12, answers=None):
    frames, truth = presses(count, 1)
    return model.fit(
        frames,
        answers or truth,
        validation=presses(4, 2),
        rng=np.random.default_rng(0),
        progress=Epochs(),
    )


def make(make_model, **parameters):
    return make_model(epochs=1, grid=Grid.centred(16, 1.6), **parameters)


def test_the_default_mixes_half_as_many_frames_as_it_has_presses(make_model, mixed):
    report = fit(make(make_model))
    ((frames, count, law, misfit),) = mixed
    assert (frames, count, law) == (12, 6 + 6, None)
    assert misfit > 0
    assert report.notes["mixed"] == 6
    assert report.notes["mixing"] == 0.5


def test_frames_that_cannot_be_mixed_are_learned_as_they_are(make_model):
    """They carry no rest image; whoever asks for mixing is told so."""
    report = fit(make(make_model), count=24)
    assert "rest image" in report.notes["not_mixed"]
    with pytest.raises(UserError, match="rest image"):
        fit(make(make_model, mixing=1.0), count=24)


def test_further_contacts_must_stand_as_high_as_the_held_out_frames_ask(
    make_model, mixed, tmp_path, monkeypatch
):
    model = make(make_model)
    monkeypatch.setattr("tactibench_unet.model.least_share", lambda *_: 0.25)
    fit(model)
    monkeypatch.setattr(
        model._encoder.__class__,
        "decode_batch",
        lambda *_: [Contacts([[0, 0], [4, 0], [0, 4]], [4, 1, 0.9], [0.8, 0.2, 0.19])],
    )
    assert len(model.read_maps(np.zeros((1, 1, 16, 16)))[0]) == 2
    model.save(tmp_path)
    other = make(make_model)
    other.load(tmp_path)
    assert len(other.read_maps(np.zeros((1, 1, 16, 16)))[0]) == 2


def contacts(*scores):
    return Contacts(np.zeros((len(scores), 2)), np.ones(len(scores)), scores)


def test_the_least_share_is_the_smallest_that_counts_best():
    """Bumps reach a tenth of their contact, and one true contact is a fifth of its neighbour."""
    predicted = [contacts(0.8, 0.08), contacts(0.5, 0.03), contacts(0.9, 0.18), contacts(0.4)]
    truth = [contacts(1), contacts(1), contacts(1, 1), contacts(1)]
    assert 0.1 < least_share(predicted, truth) <= 0.2
    assert least_share(predicted[2:], truth[2:]) == 0.0
    assert least_share([], []) == 0.0


def pins(count=8, size=64):
    """(count, 2, size, size) frames of bright spots on dark ground, and their rest frames."""
    axis = torch.arange(size) % 8
    spots = 20.0 + 180 * ((axis[None] == 4) & (axis[:, None] == 4))
    return torch.stack([spots.roll(2, 0), spots]).expand(count, 2, size, size).clone()


def network(**options):
    torch.manual_seed(0)
    return UNetNetwork(8, 4, (32, 32), 1, images=2, **options).eval()


def test_the_light_of_a_frame_with_its_rest_frame_changes_nothing():
    """Exactly, where no grey level is rounded or cut off."""
    images, answers = pins(), network()
    for factor in (0.25, 1.25):
        other = images.clone()
        other[:, 0] *= factor
        assert torch.allclose(answers(other), answers(images), atol=1e-4)
    black = images.clone()
    black[:, 0] = 0
    assert torch.isfinite(answers(black)).all()


def test_faults_leave_rest_frames_and_the_other_frames():
    images = pins()
    torch.manual_seed(1)
    some = disturb(images, 0.5)
    assert torch.equal(some[:, 1], images[:, 1])
    assert torch.equal(some[4:], images[4:])
    assert all((a != b).any() for a, b in zip(some[:4, 0], images[:4, 0], strict=True))
    assert torch.equal(disturb(images, 0.0), images)
    assert some.min() >= 0
    assert some.max() <= 255


def test_only_training_sees_faults():
    images, seen = pins(), network(faults=1.0)
    assert torch.equal(seen(images), seen(images))
    seen.stem.train()  # as when the statistics of batch normalisation are measured
    assert not torch.equal(seen(images), seen(images))


def test_under_faults_it_learns_from_empty_frames_too(make_model):
    frames, truth = presses(40, 1)
    frames = [replace(frame, rest=np.full((64, 64), 20, np.uint8)) for frame in frames]
    model = make_model(epochs=1, faults=0.5, mixing=0.0)
    assert len(model.empty_frames(frames)) == 2
    report = model.fit(
        frames, truth, validation=([], []), rng=np.random.default_rng(0), progress=Epochs()
    )
    assert np.isfinite(report.history[-1]["loss"])
    assert make_model().empty_frames(frames) == []
