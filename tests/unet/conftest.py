"""A U-Net as small as it gets, and an encoder small enough to read: no other plugin."""

import numpy as np
import pytest
from drawn_presses import fit

from tactibench import Contacts, Encoder, Grid, ModelContext

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


@pytest.fixture(scope="session")
def make_model():
    from tactibench_unet import UNet

    def _make(answer="contacts", grid=None, **parameters):
        grid = grid or Grid.centred(64, 0.4)
        context = ModelContext(answer, grid, 6.0, encoder=PeakEncoder())
        return UNet(context, **{"width": 8, "size": 64, "epochs": 2} | parameters)

    return _make


@pytest.fixture(scope="session")
def trained(make_model):
    model = make_model()
    fit(model)
    return model
