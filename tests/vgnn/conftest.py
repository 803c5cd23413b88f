"""Drawn frames of a sensor with 37 pins that flee from a press, and a small VGNN."""

import numpy as np
import pytest
from drawn_pins import REST, draw, presses, pushed
from silent import Epochs

from tactibench import Frame, Grid, ModelContext, Pose


@pytest.fixture(scope="session")
def make_presses():
    return presses


@pytest.fixture(scope="session")
def rest_frame():
    return Frame(draw(REST), 0.0, Pose(), draw(REST))


@pytest.fixture(scope="session")
def rest_pins():
    return REST.copy()


@pytest.fixture(scope="session")
def push_pins():
    return pushed


@pytest.fixture(scope="session")
def make_vgnn():
    from tactibench_vgnn import VGNN

    def _make(answer="contacts", checkpoints=None, **parameters):
        context = ModelContext(answer, Grid.centred(64, 0.4), 6.0, checkpoints=checkpoints)
        return VGNN(context, **{"width": 16, "layers": 2, "epochs": 2} | parameters)

    return _make


@pytest.fixture(scope="session")
def fit():
    def _fit(model, count=64, seed=3, plate=False):
        progress = Epochs()
        frames, truth = presses(count, 1, plate)
        report = model.fit(
            frames,
            truth,
            validation=presses(16, 2, plate),
            rng=np.random.default_rng(seed),
            progress=progress,
        )
        return report, progress

    return _fit
