"""Frames of a drawn press and a CNN as small as it gets."""

import numpy as np
import pytest

from tactibench import Contacts, Frame, Grid, ModelContext, PlatePose, Pose


class Silent:
    """A Progress that remembers the epochs and draws nothing."""

    def __init__(self):
        self.epochs = []

    def start(self, epochs, steps): ...

    def step(self, loss): ...

    def epoch(self, epoch, loss, validation_mm):
        self.epochs.append((epoch, loss, validation_mm))


def press(x, y, depth, size=64):
    """A bright spot whose place and width tell the contact."""
    axis = (np.arange(size) + 0.5) / size * 25.6 - 12.8
    square = (axis[None, :] - x) ** 2 + (axis[:, None] - y) ** 2
    image = 20 + 200 * np.exp(-square / (2 * (0.5 + depth / 2) ** 2))
    return Frame(image.astype(np.uint8), 0.0, Pose(x, y, 0, 0, depth))


def presses(count, seed, plate=False):
    """Contacts, or plates with labels from -4 to 1 mm, as a robot's z."""
    rng = np.random.default_rng(seed)
    frames, truth = [], []
    for _ in range(count):
        x, y = rng.uniform(-6, 6, 2)
        depth = rng.uniform(1, 6)
        frames.append(press(x, 0.0 if plate else y, depth))
        truth.append(PlatePose(depth - 5, 3 * x) if plate else Contacts.truth([[x, y]], [depth]))
    return frames, truth


@pytest.fixture(scope="session")
def make_presses():
    return presses


@pytest.fixture(scope="session")
def silent():
    return Silent


@pytest.fixture(scope="session")
def make_cnn():
    from tactibench_cnn.model import CNN

    def _make(answer="contacts", checkpoints=None, **parameters):
        context = ModelContext(answer, Grid.centred(64, 0.4), 6.0, checkpoints=checkpoints)
        return CNN(context, **{"width": 8, "size": 64, "epochs": 2} | parameters)

    return _make


@pytest.fixture(scope="session")
def fit():
    def _fit(model, count=24, seed=3, plate=False, progress=None):
        frames, truth = presses(count, 1, plate)
        return model.fit(
            frames,
            truth,
            validation=presses(6, 2, plate),
            rng=np.random.default_rng(seed),
            progress=progress or Silent(),
        )

    return _fit


@pytest.fixture(scope="session")
def trained(make_cnn, fit):
    model = make_cnn()
    fit(model)
    return model
