"""The simulated sensor, and a superposition fit of 300 of its single presses."""

import numpy as np
import pytest

from tactibench import Grid, Indenter, ModelContext, Pose, Scene, SensorContext
from tactibench.geometry import true_contacts
from tactibench.plugins import PluginHost
from tactibench.run import NullProgress

SETS = {"fit": 300, "validation": 50, "test": 60, "dual": 40, "law": 160, "crowded": 24}


def single(rng):
    return Scene(Indenter.single(), Pose(*rng.uniform(-6.4, 6.4, 2), depth=rng.uniform(0.5, 6)))


def dual(rng):
    pose = Pose(*rng.uniform(-1, 1, 2), rng.uniform(0, 180), 0, rng.uniform(1.5, 4))
    return Scene(Indenter.dual(rng.uniform(9, 11)), pose)


def crowded(rng):
    """Two deep tips far apart: pins between them touch."""
    pose = Pose(*rng.uniform(-0.3, 0.3, 2), rng.uniform(0, 180), 0, rng.uniform(5.7, 6.0))
    return Scene(Indenter.dual(rng.uniform(10.8, 11.2)), pose)


KINDS = {"dual": dual, "law": dual, "crowded": crowded}


@pytest.fixture(scope="session")
def host():
    return PluginHost()


@pytest.fixture(scope="session")
def presses(host):
    """Name -> (frames, truth); "rest" is one untouched frame."""
    spec = host.sensors["tactip-127"]
    rng = np.random.default_rng(1)
    # Long pins crowd; the law is that of presses without friction.
    settings = spec.settings({"friction": "0", "pin_length": "2"})
    sensor = spec.build(SensorContext(np.random.SeedSequence(0)), **settings)
    found = {}
    with sensor:
        for name, count in SETS.items():
            kind = KINDS.get(name, single)
            scenes = [kind(rng) for _ in range(count)]
            found[name] = (
                list(sensor.press_many(scenes)),
                [true_contacts(scene) for scene in scenes],
            )
        found["rest"] = ([sensor.rest()], [])
    return found


@pytest.fixture(scope="session")
def make(host):
    spec = host.models["superpose"]

    def _make(**parameters):
        context = ModelContext("contacts", Grid.centred(64, 0.4), 6.0)
        given = {name: str(value) for name, value in parameters.items()}
        return spec.build(context, **spec.settings(given))

    return _make


@pytest.fixture(scope="session")
def fit(presses):
    def _fit(model, frames=None, truth=None, validation=None):
        known = presses["fit"]
        return model.fit(
            known[0] if frames is None else frames,
            known[1] if truth is None else truth,
            validation=presses["validation"] if validation is None else validation,
            rng=np.random.default_rng(0),
            progress=NullProgress(),
        )

    return _fit


@pytest.fixture(scope="session")
def fitted(make, fit):
    """Regime single: the model and its report."""
    model = make()
    return model, fit(model)


@pytest.fixture(scope="session")
def fitted_to_duals(make, fit, presses):
    """Regime multiple: 160 presses with two tips among the training frames."""
    model = make()
    frames, truth = (presses["fit"][k] + presses["law"][k] for k in (0, 1))
    return model, fit(model, frames, truth)
