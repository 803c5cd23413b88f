"""The model on drawn frames of 37 pins, with the encoder that reads its maps."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_pins import presses
from silent import Epochs

from tactibench import Grid, ModelContext


@pytest.fixture(scope="session")
def make_mixture():
    from tactibench_heatmaps import Mixture as Encoder
    from tactibench_mixture import Mixture

    def _make(grid=None, encoder=None, **parameters):
        context = ModelContext(
            "contacts", grid or Grid.centred(64, 0.4), 6.0, encoder or Encoder(threshold=0.5)
        )
        return Mixture(context, **{"width": 8, "epochs": 2} | parameters)

    return _make


@pytest.fixture(scope="session")
def fit():
    def _fit(model, frames, truth):
        return model.fit(
            frames,
            truth,
            validation=presses(24, 2),
            rng=np.random.default_rng(3),
            progress=Epochs(),
        )

    return _fit
