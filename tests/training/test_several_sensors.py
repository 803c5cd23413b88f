"""Mixture models on sensors that they were not trained on, and on several."""

import numpy as np
import pytest
from silent import Epochs

from tactibench import Grid, Indenter, ModelContext, Pose, Scene, SensorContext
from tactibench.geometry import true_contacts
from tactibench.plugins.host import PluginHost
from tactibench_sim.sensor import TacTip127

SMALL = {
    "mixture": {"width": "16", "epochs": "1"},
    "vgnn": {"width": "16", "layers": "1", "epochs": "1"},
}
every = pytest.mark.parametrize("name", SMALL)


def pressed(count, seed, **parameters):
    """Frames and truth of single presses."""
    rng = np.random.default_rng(seed)
    scenes = [
        Scene(Indenter.single(), Pose(*rng.uniform(-4, 4, 2), depth=rng.uniform(1, 3)))
        for _ in range(count)
    ]
    sensor = TacTip127(SensorContext(np.random.SeedSequence(seed)), threads=1, **parameters)
    return list(sensor.press_many(scenes)), [true_contacts(scene) for scene in scenes]


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
    frames, truth = pressed(12, 1, noise=False)
    model.prepare(frames, truth)
    turned, _ = pressed(12, 1, noise=False, roll=3.0, camera_distance=53.0)
    own, other = (model.inputs(some).numpy() for some in (frames, turned))
    if name == "vgnn":  # discs have few pixels: how a pin's picture grows is all but noise
        own, other = own[..., :3], other[..., :3]
    assert np.sqrt(np.square(own - other).mean()) < 0.06 * np.sqrt(np.square(own).mean())


@every
def test_it_learns_from_several_sensors_and_keeps_what_it_learned(make, name, tmp_path):
    model = make(name)
    model.fit(
        *pressed(36, 2, instances=3),
        validation=pressed(4, 3, instances=3),
        rng=np.random.default_rng(0),
        progress=Epochs(),
    )
    model.save(tmp_path)
    again = make(name)
    again.load(tmp_path)
    unseen = [*pressed(4, 4, instance=3)[0], *pressed(4, 5)[0]]
    mixed = [unseen[k] for k in (4, 0, 5, 1, 6, 2, 7, 3)]
    together = model.evaluate(mixed)
    np.testing.assert_array_equal(again.evaluate(mixed), together)
    alone = np.concatenate([model.evaluate([frame]) for frame in mixed])
    np.testing.assert_allclose(alone, together, atol=1e-3)
