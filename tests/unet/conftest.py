"""Frames of a drawn press and an encoder small enough to read: no plugin but the tested one."""

import math

import numpy as np
import pytest
from silent import Epochs

from tactibench import Contacts, Encoder, Frame, Grid, ModelContext, PlatePose, Pose

SIGMA_MM = 2.0


class PeakEncoder(Encoder):
    """Gaussians of the height depth / 6, read back at the highest cell. One contact at most."""

    channels, separation, tolerance = 1, 5.0, 0.3

    def encode(self, contacts, grid):
        x, y = grid.axes()
        maps = np.zeros((1, *grid.shape), dtype=np.float32)
        for (cx, cy), depth in zip(contacts.xy, contacts.depth, strict=True):
            square = (x[None, :] - cx) ** 2 + (y[:, None] - cy) ** 2
            maps[0] = np.maximum(maps[0], depth / 6 * np.exp(-square / (2 * SIGMA_MM**2)))
        return maps

    def decode(self, maps, grid):
        row, column = np.unravel_index(maps[0].argmax(), grid.shape)
        height = min(1.0, float(maps[0, row, column]))
        return Contacts([grid.xy(row, column)], [6 * height], [height])


def press(x, y, depth, size=64):
    """A bright spot whose place and width tell the contact."""
    axis = (np.arange(size) + 0.5) / size * 25.6 - 12.8
    square = (axis[None, :] - x) ** 2 + (axis[:, None] - y) ** 2
    image = 20 + 200 * np.exp(-square / (2 * (0.5 + depth / 2) ** 2))
    return Frame(image.astype(np.uint8), 0.0, Pose(x, y, 0, 0, depth))


def presses(count, seed, plate=False):
    rng = np.random.default_rng(seed)
    frames, truth = [], []
    for _ in range(count):
        x, y = rng.uniform(-6, 6, 2)
        depth = rng.uniform(1, 6)
        frames.append(press(x, 0.0 if plate else y, depth))
        if plate:
            truth.append(PlatePose(depth - 5, math.degrees(math.asin(x / 20))))
        else:
            truth.append(Contacts.truth([[x, y]], [depth]))
    return frames, truth


@pytest.fixture(scope="session")
def make_presses():
    return presses


@pytest.fixture(scope="session")
def silent():
    return Epochs


@pytest.fixture(scope="session")
def make_model():
    """make_model(...): a U-Net as small as it gets."""
    from tactibench_unet.model import UNet

    def _make(answer="contacts", checkpoints=None, encoder=None, grid=None, **parameters):
        context = ModelContext(
            answer=answer,
            grid=grid or Grid.centred(64, 0.4),
            max_depth=6.0,
            encoder=encoder or PeakEncoder(),
            checkpoints=checkpoints,
        )
        return UNet(context, **{"width": 8, "size": 64, "epochs": 2} | parameters)

    return _make


@pytest.fixture(scope="session")
def fit():
    """fit(model): train on a few presses."""

    def _fit(model, count=24, seed=3, plate=False, progress=None):
        frames, truth = presses(count, 1, plate)
        return model.fit(
            frames,
            truth,
            validation=presses(6, 2, plate),
            rng=np.random.default_rng(seed),
            progress=progress or Epochs(),
        )

    return _fit


@pytest.fixture(scope="session")
def trained(make_model, fit):
    model = make_model()
    fit(model)
    return model
