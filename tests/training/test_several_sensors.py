"""Mixture models on sensors that they were not trained on, and on several."""

import numpy as np
import pytest
from single_presses import single_presses

from tactibench import Grid, ModelContext
from tactibench.plugins import PluginHost

SMALL = {
    "mixture": {"width": "16", "epochs": "1"},
    "vgnn": {"width": "16", "layers": "1", "epochs": "1"},
}
every = pytest.mark.parametrize("name", SMALL)


@pytest.fixture(scope="module")
def make():
    host = PluginHost()
    encoder = host.encoders["mixture"]
    read = encoder.load()(**encoder.settings({}))

    def _make(name):
        spec = host.models[name]
        context = ModelContext("contacts", Grid.centred(64, 0.4), 6.0, read)
        return spec.load()(context, **spec.settings(SMALL[name]))

    return _make


@every
def test_a_camera_that_is_turned_and_nearer_gives_the_network_the_same(make, name):
    model = make(name)
    frames, truth = single_presses(12, 1, noise=False)
    model.prepare(frames, truth)
    turned, _ = single_presses(12, 1, noise=False, roll=3.0, camera_distance=53.0)
    own, other = (model.inputs(some).numpy() for some in (frames, turned))
    if name == "vgnn":  # discs have few pixels: how a pin's picture grows is all but noise
        own, other = own[..., :3], other[..., :3]
    assert np.sqrt(np.square(own - other).mean()) < 0.06 * np.sqrt(np.square(own).mean())
