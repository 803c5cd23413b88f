"""LearnedModel with a network of two weights: a frame's mean brightness tells the depth."""

import sys
from types import ModuleType

import numpy as np
import pytest
import torch
from silent import Epochs
from state_hash import state_hash
from torch import nn

from tactibench import Contacts, Frame, Grid, ModelContext, PlatePose, Pose, UserError
from tactibench.training import LearnedModel, Recipe, image_tensor, position_error_mm


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


def test_it_learns(make):
    model = make(epochs=60)
    fit(model, presses(100))
    frames, truth = presses(20, 9)
    assert np.abs(depths(model.predict(frames)) - depths(truth)).mean() < 0.3


def test_scales_are_learned_before_the_targets_and_the_network_starts_from_them(make):
    model = make()
    data = presses(40)
    fit(model, data)
    assert model.prepared_on == model.started_on == 40
    assert model.scale == depths(data[1]).max()


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


def test_without_validation_frames_it_trains_on(make):
    assert "validation_loss" not in fit(make(), held_out=([], [])).history[0]


def test_mixing_adds_its_share_of_frames_before_anything_is_learned(make, mixed):
    frames, truth = presses(41)
    truth[1] = Contacts.none()
    model = make(mixing=0.5)
    report = fit(model, (frames, truth))
    ((given, count),) = mixed
    assert given == [contacts for contacts in truth if len(contacts)]
    assert count == report.notes["mixed"] == 20
    assert model.prepared_on == model.started_on == 40 + 20


def test_mixing_comes_from_the_rng_and_leaves_the_other_seeds_alone(make, mixed):
    first, second, third = make(mixing=0.5), make(mixing=0.5), make()
    fit(first)
    fit(second)
    fit(third)
    assert state_hash(first.network) == state_hash(second.network)
    assert state_hash(first.network) != state_hash(third.network)
    assert len(mixed) == 2


def test_operations_are_counted_by_hand(make):
    """Convolution: 36 cells x 4 kernels x 9 products; dense: 4; each product has a sum."""
    assert make().flops(presses(1)[0][0]) == 2 * (36 * 4 * 9 + 4)


def test_an_untrained_network_is_the_same_every_time(make):
    assert state_hash(make().network) == state_hash(make().network)
    assert make().parameter_count() == 4 * 9 + 8 + 5


def staged(model, frames):
    value = frames
    for _, stage in model.stages():
        value = stage(value)
    return value


def test_stages_are_those_of_the_weights_in_use(make):
    model = make()
    frames, _ = presses(5, 4)
    before = depths(staged(model, frames))
    fit(model)
    value = staged(model, frames)
    assert [name for name, _ in model.stages()] == ["preprocess", "forward", "decode"]
    np.testing.assert_array_equal(depths(value), depths(model.predict(frames)))
    assert not np.allclose(depths(value), before)


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
