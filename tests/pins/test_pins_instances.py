"""Learning from frames of several sensor instances, each with its own rest image."""

import numpy as np
import pytest
from single_presses import single_presses

from tactibench import UserError
from tactibench.markers import PinTracker, rest_images
from tactibench.run import NullProgress
from tactibench_pins import LatticePins, OwnPins, find_reader

both = pytest.mark.parametrize("name", ["kernel", pytest.param("pins", marks=pytest.mark.long)])


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
    return single_presses(300, 1, instances=5)


@both
def test_an_unseen_instance_is_read_by_its_own_rest_image(make_model, many, name, tmp_path):
    more = {"epochs": 60} if name == "pins" else {}
    model = make_model(name, answer="contacts", **more)
    model.fit(
        *many,
        validation=single_presses(40, 2, instances=5),
        rng=np.random.default_rng(0),
        progress=NullProgress(),
    )
    unseen = single_presses(40, 3, instance=23)
    nominal = single_presses(40, 4)
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
    assert type(find_reader(many[0], targets, transfers=False)) is LatticePins
    frames, _ = single_presses(5, 1)
    assert len(rest_images(frames)) == 1
    assert type(find_reader(frames, targets, transfers=False)) is OwnPins


def test_a_model_that_follows_the_pins_of_one_sensor_refuses_several(many):
    with pytest.raises(UserError, match=r"5 sensor instances.*sensor.instances=0"):
        PinTracker.of(many[0])
