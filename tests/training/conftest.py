"""A tiny task on which the loop can be watched: tell the mean brightness of an image."""

import numpy as np
import pytest
import torch
from torch import nn

from tactibench.training import Examples, Recipe, Seeds, torch_seed, train


class InterruptedRunError(Exception):
    """What the tests raise from a progress callback."""


class Recorder:
    """A Progress that remembers, and stops the training where it is told to."""

    def __init__(self, stop_after_epoch=None, stop_at_step=None):
        self.stop_after_epoch, self.stop_at_step = stop_after_epoch, stop_at_step
        self.started, self.losses, self.epochs = None, [], []

    def start(self, epochs, steps):
        self.started = (epochs, steps)

    def step(self, loss):
        self.losses.append(loss)
        if len(self.losses) == self.stop_at_step:
            raise InterruptedRunError

    def epoch(self, epoch, loss, validation_mm):
        self.epochs.append((epoch, loss, validation_mm))
        if epoch == self.stop_after_epoch:
            raise InterruptedRunError


class TinyNetwork(nn.Module):
    """Convolution, normalisation, dropout and a dense layer: everything that has a state."""

    def __init__(self):
        super().__init__()
        self.features = nn.Sequential(
            nn.Conv2d(1, 4, 3, padding=1, bias=False), nn.BatchNorm2d(4), nn.ReLU()
        )
        self.head = nn.Sequential(nn.Dropout(0.2), nn.Linear(4, 1))

    def forward(self, images):
        return self.head(self.features(images.float() / 255 - 0.5).mean(dim=(2, 3)))


def examples(count, seed):
    rng = np.random.default_rng(seed)
    level = rng.uniform(60, 200, (count, 1, 1, 1))
    images = (level + rng.normal(0, 10, (count, 1, 8, 8))).clip(0, 255).astype(np.uint8)
    targets = (level.reshape(count, 1) / 100 - 1.3).astype(np.float32)
    return Examples(torch.from_numpy(images), torch.from_numpy(targets))


@pytest.fixture
def recorder():
    return Recorder


@pytest.fixture
def interrupted():
    return InterruptedRunError


@pytest.fixture
def make_examples():
    return examples


@pytest.fixture
def recipe():
    return Recipe(
        epochs=4,
        batch=8,
        learning_rate=1e-2,
        weight_decay=1e-2,
        precision="float32",
        average=0.9,
    )


@pytest.fixture
def run(recipe):
    """Train the tiny task: run(checkpoints=..., progress=..., ...) -> (network, report)."""

    def _run(seed=7, **changes):
        seeds = Seeds.draw(np.random.default_rng(seed))
        with torch_seed(seeds.init):
            network = TinyNetwork()
        settings = {
            "recipe": recipe,
            "loss": nn.functional.mse_loss,
            "error_mm": lambda outputs, rows: float(outputs.std()) + len(rows),
            "seeds": seeds,
            "identity": {"model": "tiny"},
            "progress": Recorder(),
        } | changes
        training = settings.pop("training", examples(30, 1))
        report = train(network, training, settings.pop("validation", examples(9, 2)), **settings)
        return network, report

    return _run
