"""Frames of a drawn press on a square of pins, and an encoder small enough to read."""

from __future__ import annotations

import math

import numpy as np
import pytest
from silent import Epochs
from stubs import StubEncoder

from tactibench import Contacts, Frame, Grid, ModelContext, PlatePose, Pose
from tactibench.training import MixtureReader

SIDE = 64
GRID = Grid.centred(64, 0.4)
MM = 0.4  # a pixel


class CellEncoder(StubEncoder):
    """Reads the 7 maps of a mixture."""

    channels, separation, tolerance = 7, 2.0, 1e-5

    def decode_batch(self, maps, grid):
        x, y = grid.axes()
        cells = maps.reshape(len(maps), 7, -1).transpose(0, 2, 1).astype(float)
        mean = cells[..., 1:4]
        mean[..., :2] += np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return MixtureReader().read_all(cells[..., 0], mean, cells[..., 4:])


def pins(shift=0.0):
    axis = np.arange(-4, 5) * 6.5 + (SIDE - 1) / 2
    return np.stack(np.meshgrid(axis + shift, axis), axis=-1).reshape(-1, 2)


def picture(xy):
    """Bright Gaussian spots at xy (P, 2) px."""
    axis = np.arange(SIDE)
    along = np.exp(-((axis - xy[..., None]) ** 2) / (2 * 1.2**2))
    image = 15 + 200 * np.einsum("px,py->yx", along[:, 0], along[:, 1])
    return image.clip(0, 255).round().astype(np.uint8)


def press(contacts, rest=None):
    """Pins are pushed away from every contact, the more the deeper it is."""
    base = pins()
    moved = base.copy()
    for (x, y), depth in zip(contacts.xy, contacts.depth, strict=True):
        away = base - (np.array([x, y]) / MM + (SIDE - 1) / 2)
        push = 0.25 * depth * np.exp(-(away**2).sum(1) / (2 * 8.0**2))
        moved += push[:, None] * away / 8.0
    return Frame(picture(moved), 0.0, Pose(), picture(base) if rest is None else rest)


def presses(count, seed, plate=False, most=1):
    rng = np.random.default_rng(seed)
    rest = picture(pins())
    frames, truth = [], []
    for number in range(count):
        several = 1 if plate else 1 + number % most
        xy = rng.uniform(-5, 5, (several, 2))
        if several == 2:
            xy[1] = -xy[0] + np.sign(-xy[0]) * 3
        xy[:, 1] *= not plate
        contacts = Contacts.truth(xy, rng.uniform(2, 6, several))
        frames.append(press(contacts, rest))
        tilt = math.degrees(math.asin(xy[0, 0] / 20))
        truth.append(PlatePose(contacts.depth[0] - 5, tilt) if plate else contacts)
    return frames, truth


@pytest.fixture(scope="session")
def make_presses():
    return presses


@pytest.fixture(scope="session")
def draw():
    return press, picture, pins


@pytest.fixture(scope="session")
def silent():
    return Epochs


@pytest.fixture(scope="session")
def make_mixture():
    from tactibench_mixture import Mixture

    def _make(answer="contacts", checkpoints=None, grid=GRID, encoder=None, **parameters):
        context = ModelContext(answer, grid, 6.0, encoder or CellEncoder(), checkpoints=checkpoints)
        return Mixture(context, **{"width": 8, "epochs": 2} | parameters)

    return _make


@pytest.fixture(scope="session")
def fit():
    def _fit(model, count=24, seed=3, plate=False, progress=None, most=1):
        frames, truth = presses(count, 1, plate, most)
        return model.fit(
            frames,
            truth,
            validation=presses(24, 2, plate),
            rng=np.random.default_rng(seed),
            progress=progress or Epochs(),
        )

    return _fit


@pytest.fixture(scope="session")
def trained(make_mixture, fit):
    model = make_mixture(epochs=30)
    model.report = fit(model, count=192)
    return model
