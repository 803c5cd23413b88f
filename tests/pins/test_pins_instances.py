"""Learning from frames of several sensor instances, each with its own rest image."""

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench.geometry import DOME_RADIUS_MM, true_contacts
from tactibench.markers import PinTracker, rest_images
from tactibench.run.reporter import NullProgress
from tactibench_pins.displacements import LatticePins, OwnPins, find_pins
from tactibench_sim.sensor import TacTip127

both = pytest.mark.parametrize("name", ["kernel", pytest.param("pins", marks=pytest.mark.long)])


def pressed(count, seed, **parameters):
    """Frames of single presses, and their true contacts."""
    rng = np.random.default_rng(seed)
    scenes = [
        Scene(Indenter.single(), Pose(*rng.uniform(-4, 4, 2), depth=rng.uniform(1, 3)))
        for _ in range(count)
    ]
    sensor = TacTip127(SensorContext(np.random.SeedSequence(seed)), threads=1, **parameters)
    truth = [true_contacts(scene, DOME_RADIUS_MM) for scene in scenes]
    return list(sensor.press_many(scenes)), truth


def off(model, frames, truth):
    """Mean distance of answers from the truth, mm; a miss counts 3."""
    answers = model.predict(frames)
    return np.mean(
        [
            np.linalg.norm(a.xy[0] - t.xy[0]) if len(a) else 3.0
            for a, t in zip(answers, truth, strict=True)
        ]
    )


@pytest.fixture(scope="module")
def many():
    return pressed(300, 1, instances=5)


@both
def test_an_unseen_instance_is_read_by_its_own_rest_image(make_model, many, name, tmp_path):
    more = {"epochs": 60} if name == "pins" else {}
    model = make_model(name, answer="contacts", **more)
    model.fit(
        *many,
        validation=pressed(40, 2, instances=5),
        rng=np.random.default_rng(0),
        progress=NullProgress(),
    )
    unseen = pressed(40, 3, instance=3, ranges=2)
    nominal = pressed(40, 4)
    assert off(model, *unseen) < 0.8
    assert off(model, *nominal) < 0.8
    model.save(tmp_path)
    again = make_model(name, answer="contacts", **more)
    again.load(tmp_path)
    for frames, _ in (unseen, nominal):
        for one, two in zip(model.predict(frames), again.predict(frames), strict=True):
            assert np.array_equal(one.xy, two.xy)
            assert np.array_equal(one.depth, two.depth)


def test_one_rest_image_keeps_its_own_pins_and_several_are_seen_on_the_lattice(many):
    targets = np.ones((300, 3))
    assert len(rest_images(many[0])) == 5
    assert type(find_pins(many[0], targets, transfers=False)) is LatticePins
    frames, _ = pressed(5, 1)
    assert len(rest_images(frames)) == 1
    assert type(find_pins(frames, targets, transfers=False)) is OwnPins


def test_a_model_that_follows_the_pins_of_one_sensor_refuses_several(many):
    with pytest.raises(UserError, match=r"5 sensor instances.*sensor.instances=0"):
        PinTracker.of(many[0])
