"""Drawn frames of a sensor with 37 pins that flee from a press or a plate."""

from functools import partial

import numpy as np
import pytest
from drawn_pins import presses

from tactibench import Grid, ModelContext
from tactibench.run import NullProgress


@pytest.fixture(scope="session")
def make_presses():
    return partial(presses, plate=True)


@pytest.fixture(scope="session")
def make_model():
    from tactibench_pins import Kernel, Pins

    def _make(name, answer="plate", checkpoints=None, **parameters):
        context = ModelContext(answer, Grid.centred(64, 0.4), 6.0, checkpoints=checkpoints)
        if name == "kernel":
            return Kernel(context)
        return Pins(context, **{"members": 2, "width": 32, "epochs": 300} | parameters)

    return _make


@pytest.fixture(scope="session")
def fit():
    def _fit(model, count=150, seed=3, plate=True, rest=True, held=30):
        frames, truth = presses(count, 1, plate, rest)
        return model.fit(
            frames,
            truth,
            validation=presses(held, 2, plate),
            rng=np.random.default_rng(seed),
            progress=NullProgress(),
        )

    return _fit


@pytest.fixture(scope="session")
def taught(make_model, fit):
    """By name: a model that learned plates, and the report of its training."""
    made = {}
    for name in ("kernel", "pins"):
        model = make_model(name)
        made[name] = model, fit(model)
    return made
