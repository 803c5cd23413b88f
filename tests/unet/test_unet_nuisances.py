"""Light is that of the rest frame; faults are drawn anew, for some frames, in training only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from drawn_presses import presses
from silent import Epochs

from tactibench_unet import GAIN, UNetNetwork, disturb


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


def test_faults_come_from_the_seed():
    torch.manual_seed(2)
    first, second = disturb(pins(), 1.0), disturb(pins(), 1.0)
    torch.manual_seed(2)
    assert torch.equal(disturb(pins(), 1.0), first)
    assert not torch.equal(first, second)


def test_light_stays_in_its_range():
    torch.manual_seed(3)
    flat = torch.full((400, 1, 32, 32), 60.0)
    ratio = disturb(flat, 1.0).median(dim=-1).values.median(dim=-1).values.flatten() / 60
    assert ratio.min() > 0.9 * GAIN[0]
    assert ratio.max() < 1.1 * GAIN[1]
    assert ratio.min() < 0.5
    assert ratio.max() > 1.7


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
