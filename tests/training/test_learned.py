"""Learned models: LearnedModel with a network of two weights, targets, mirrors, and std.

The network tells the depth by a frame's mean brightness.
"""

from __future__ import annotations

import math
import sys
from types import ModuleType

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from silent import Epochs
from single_presses import single_presses
from state_hash import state_hash
from torch import nn

from tactibench import Contacts, Frame, Grid, ModelContext, PlatePose, Pose, UserError
from tactibench.plugins import PluginHost
from tactibench.training import (
    LearnedModel,
    PlateScale,
    Recipe,
    find_symmetry,
    fold_batch_norm,
    image_tensor,
    position_error_mm,
    scale_std,
    split_calibration,
    std_factors,
)


class Line(nn.Module):
    """Brightness over 255, normalised -> depth over a scale."""

    def __init__(self):
        super().__init__()
        self.layers = nn.Sequential(nn.Conv2d(1, 4, 3, bias=False), nn.BatchNorm2d(4), nn.ReLU())
        self.line = nn.Linear(4, 1)

    def forward(self, images):
        return self.line(self.layers(images.float() / 255).mean(dim=(2, 3)))


class Brightness(LearnedModel):
    name = "brightness"

    def __init__(self, context, size=8, epochs=2, mixing=0.0):
        recipe = Recipe(epochs=epochs, batch=8, learning_rate=1e-2, precision="float32")
        super().__init__(context, recipe, {"size": size}, mixing)
        self.scale = 1.0
        self.prepared_on = 0
        self.started_on = 0

    def build(self):
        return Line()

    def inputs(self, frames):
        return image_tensor(frames, self.architecture["size"])

    def targets(self, truth):
        depths = np.array([contacts.depth.max() for contacts in truth], dtype=np.float32)
        return torch.from_numpy(depths.reshape(-1, 1) / np.float32(self.scale))

    def loss(self, outputs, targets):
        return nn.functional.mse_loss(outputs, targets)

    def answers(self, outputs):
        return [
            Contacts([[0, 0]], [max(0.0, float(value)) * self.scale], [1])
            for value in outputs[:, 0]
        ]

    def usable_rows(self, truth):
        return np.flatnonzero([len(contacts) > 0 for contacts in truth])

    def prepare(self, frames, truth):
        self.prepared_on = len(frames)
        self.scale = float(max(contacts.depth.max() for contacts in truth))

    def initialise(self, network, training):
        self.started_on = len(training)
        with torch.no_grad():
            network.line.bias.copy_(training.targets.mean())

    def extra(self):
        return {"scale": self.scale}

    def restore(self, extra):
        self.scale = extra["scale"]


def presses(count, seed=0):
    rng = np.random.default_rng(seed)
    depths = rng.uniform(1, 6, count)
    noise = rng.normal(0, 3, (count, 8, 8))
    images = (40 * depths[:, None, None] + noise).clip(0, 255).astype(np.uint8)
    frames = [Frame(image, 0.0, Pose(0, 0)) for image in images]
    return frames, [Contacts.truth([[0, 0]], [depth]) for depth in depths]


def fit(model, data=None, held_out=None, seed=5):
    return model.fit(
        *(data or presses(40)),
        validation=held_out or presses(6, 1),
        rng=np.random.default_rng(seed),
        progress=Epochs(),
    )


@pytest.fixture
def make():
    def _make(device="cpu", checkpoints=None, **parameters):
        grid = Grid.centred(16, 1.0)
        context = ModelContext("contacts", grid, 6.0, device=device, checkpoints=checkpoints)
        return Brightness(context, **parameters)

    return _make


@pytest.fixture
def mixed(monkeypatch):
    """Stands for ``tactibench.superposition``: hands back given frames, remembers the calls."""
    calls = []

    def mix(frames, truth, count, rng):
        rows = rng.integers(0, len(frames), count)
        calls.append((list(truth), count))
        pairs = Contacts.truth([[-4, 0], [4, 0]], [1, 2])
        return [frames[row] for row in rows], [pairs] * count

    module = ModuleType("tactibench.superposition")
    module.mix = mix
    monkeypatch.setitem(sys.modules, "tactibench.superposition", module)
    return calls


def depths(answers):
    return np.array([contacts.depth[0] for contacts in answers])


def test_frames_that_cannot_be_learned_from_are_left_out_and_counted(make):
    frames, truth = presses(12)
    truth[3] = truth[7] = Contacts.none()
    model = make()
    report = fit(model, (frames, truth), (frames, truth))
    assert report.notes["without_contact"] == 2
    assert model.prepared_on == 10
    assert "validation_mm" in report.history[0]
    with pytest.raises(UserError, match="'brightness' was given no training frame"):
        fit(make(), (frames[:2], [Contacts.none()] * 2))
    with pytest.raises(UserError, match="no training frame"):
        fit(make(), ([], []))


def test_mixing_adds_its_share_of_frames_before_anything_is_learned(make, mixed):
    frames, truth = presses(41)
    truth[1] = Contacts.none()
    model = make(mixing=0.5)
    report = fit(model, (frames, truth))
    ((given, count),) = mixed
    assert given == [contacts for contacts in truth if len(contacts)]
    assert count == report.notes["mixed"] == 20
    assert model.prepared_on == model.started_on == 40 + 20


def test_operations_are_counted_by_hand(make):
    """Convolution: 36 cells x 4 kernels x 9 products; dense: 4; each product has a sum."""
    assert make().flops(presses(1)[0][0]) == 2 * (36 * 4 * 9 + 4)


def test_the_position_error_is_the_distance_to_the_nearest_answer():
    one, two = Contacts.truth([[0, 0]], [1]), Contacts.truth([[3, 4], [0, 1]], [1, 1])
    none = Contacts.none()
    assert position_error_mm([two], [one]) == 1.0
    assert position_error_mm([one], [two]) == pytest.approx((5 + 1) / 2)
    assert position_error_mm([none, two], [one, one]) == 1.0
    assert position_error_mm([none, None], [one, one]) is None
    assert position_error_mm([two], [none]) is None
    plate = position_error_mm([PlatePose(1, 30)], [PlatePose(2, -30)])
    assert plate == pytest.approx(20)  # 20 mm * (sin 30 deg + sin 30 deg)


@given(st.floats(-4, 0), st.floats(-45, 45), st.floats(0, 6))
def test_the_contact_is_read_back_as_the_plate(depth, tilt, offset):
    scale = PlateScale(offset)
    found = scale.plate(scale.contacts(PlatePose(depth, tilt)))
    assert math.isclose(found.depth, depth, abs_tol=1e-12)
    assert math.isclose(found.tilt, tilt, abs_tol=1e-9)


def test_labels_below_zero_are_drawn_above_it():
    poses = [PlatePose(-4.0, 0.0), PlatePose(0.0, 5.0)]
    scale = PlateScale.of(poses, 6.0)
    assert [float(scale.contacts(pose).depth[0]) for pose in poses] == [0.5, 4.5]
    with pytest.raises(UserError, match=r"-4\.00 to 3\.00 mm"):
        PlateScale.of([*poses, PlatePose(3.0, 0.0)], 6.0)


SMALL = {
    "mixture": {"width": "16", "epochs": "1"},
    "vgnn": {"width": "16", "layers": "1", "epochs": "1"},
}
every = pytest.mark.parametrize("name", SMALL)


@pytest.fixture(scope="module")
def make_reader():
    host = PluginHost()
    encoder = host.encoders["mixture"]
    read = encoder.build(**encoder.settings({}))

    def _make(name):
        spec = host.models[name]
        context = ModelContext("contacts", Grid.centred(64, 0.4), 6.0, read)
        return spec.build(context, **spec.settings(SMALL[name]))

    return _make


@every
def test_a_camera_that_is_turned_and_nearer_gives_the_network_the_same(make_reader, name):
    model = make_reader(name)
    frames, truth = single_presses(12, 1, noise=False)
    model.prepare(frames, truth)
    turned, _ = single_presses(12, 1, noise=False, roll=3.0, focal=0.3006)
    own, other = (model.inputs(some).numpy() for some in (frames, turned))
    if name == "vgnn":  # how discs and the cells between pins grow is all but noise here
        own, other = own[..., :2], other[..., :2]
    assert np.sqrt(np.square(own - other).mean()) < 0.06 * np.sqrt(np.square(own).mean())


def test_a_frame_is_its_own_mirror_image_up_to_noise() -> None:
    rng = np.random.default_rng(0)
    half = rng.integers(0, 200, (16, 8))
    across = np.concatenate([half, half[:, ::-1]], axis=1)
    noisy = (across + rng.normal(0, 1.5, across.shape)).clip(0, 255).astype(np.uint8)
    assert find_symmetry(noisy) == (True, False)
    assert find_symmetry(noisy.T.copy()) == (False, True)
    assert find_symmetry(np.full((9, 9), 7, np.uint8)) == (True, True)
    assert find_symmetry(rng.integers(0, 255, (16, 16)).astype(np.uint8)) == (False, False)


def test_a_folded_network_answers_as_before():
    network = nn.Sequential(
        nn.Sequential(nn.Conv2d(1, 3, 3, bias=False), nn.BatchNorm2d(3), nn.ReLU(inplace=True)),
        nn.Conv2d(3, 2, 1),
        nn.BatchNorm2d(2),
    )
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.running_mean, -1, 1)
            nn.init.uniform_(module.running_var, 0.2, 2)
            nn.init.uniform_(module.weight, -1, 1)
            nn.init.uniform_(module.bias, -1, 1)
    before = state_hash(network)
    folded = fold_batch_norm(network)
    images = torch.rand(4, 1, 9, 9)
    with torch.inference_mode():
        expected = network.eval()(images)
        torch.testing.assert_close(folded(images), expected, rtol=1e-5, atol=1e-6)
    assert not any(isinstance(module, nn.BatchNorm2d) for module in folded.modules())
    assert state_hash(network) == before


def drawn(count, std, stated, seed=0, contacts=1):
    """Truth at 5 mm from each other, and answers off by a Gaussian of ``std``."""
    rng = np.random.default_rng(seed)
    truth, found = [], []
    for _ in range(count):
        true = np.column_stack([5.0 * np.arange(contacts), np.zeros(contacts), np.ones(contacts)])
        off = true + rng.normal(size=true.shape) * std
        truth.append(Contacts.truth(true[:, :2], true[:, 2]))
        std_ = np.tile(stated, (contacts, 1))
        found.append(Contacts(off[:, :2], off[:, 2], np.ones(contacts), std_))
    return found, truth


def coverage(found, truth):
    error = np.concatenate([f.xy - t.xy for f, t in zip(found, truth, strict=True)])
    std = np.concatenate([f.std[:, :2] for f in found])
    return float((((error / std) ** 2).sum(axis=1) < -2 * np.log(0.05)).mean())


def test_std_that_are_too_small_become_the_true_ones():
    found, truth = drawn(4000, [0.02, 0.05, 0.1], [0.01, 0.05, 0.2])
    factors = std_factors(found, truth)
    np.testing.assert_allclose(factors[0], [2, 1, 0.5], rtol=0.06)
    assert np.array_equal(factors[0], factors[1])
    scaled = [scale_std(contacts, factors) for contacts in found]
    assert coverage(scaled, truth) == pytest.approx(0.95, abs=2e-3)


def test_contacts_beside_others_have_factors_of_their_own():
    alone, alone_truth = drawn(500, [0.02] * 3, [0.02] * 3)
    beside, beside_truth = drawn(500, [0.06] * 3, [0.02] * 3, seed=1, contacts=2)
    factors = std_factors([*alone, *beside], [*alone_truth, *beside_truth])
    np.testing.assert_allclose(factors, [[1] * 3, [3] * 3], rtol=0.1)
    assert np.array_equal(scale_std(beside[0], factors).std, beside[0].std * factors[1])


def test_95_percent_lie_inside_whatever_the_distribution():
    rng, std = np.random.default_rng(2), np.array([0.1, 0.2, 0.05])
    truth = [Contacts.truth([[0, 0]], [1])] * 500
    errors = rng.standard_t(2, (500, 3))
    found = [Contacts([e[:2]], [1 + e[2]], [1], [std]) for e in errors]
    factors = std_factors(found, truth)
    scaled = [scale_std(contacts, factors) for contacts in found]
    assert coverage(scaled, truth) == pytest.approx(0.95, abs=2e-3)
    assert np.mean(np.abs(errors[:, 2] / (std * factors[0])[2]) <= 1.96) == pytest.approx(
        0.95, abs=3e-3
    )


def test_every_twentieth_frame_with_several_contacts_is_for_calibration():
    one, two = Contacts.truth([[0, 0]], [1]), Contacts.truth([[0, 0], [5, 0]], [1, 1])
    used, kept = split_calibration([one, two] * 45)
    assert kept.tolist() == [39, 79]
    assert sorted([*used, *kept]) == list(range(90))
    assert split_calibration([one] * 100)[1].size == 0
    assert split_calibration([PlatePose(1, 2)] * 100)[1].size == 0
    assert split_calibration([])[0].size == 0
