"""Presses spread over sensor instances: which instance, whose rest frame, never a reserved one."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench.plugins import PluginHost
from tactibench_sim import instances, training_instances
from tactibench_sim.instances import RATIO_FACTOR, SKIN_FACTOR, dome_of, perturb
from tactibench_sim.sensor import TACTIP_127, TacTip127, TacTip331
from tactibench_sim.tolerances import TOLERANCES, Tolerances, dome_factors, modulus
from tactibench_sim.training_instances import TrainingInstances

ENDS = st.dictionaries(
    st.sampled_from([field.name for field in dataclasses.fields(Tolerances)]), st.floats(-1, 1)
)


def sensor(seed=3, kind=TacTip127, **parameters):
    parameters = {"size": 64, "threads": 1} | parameters
    return kind(SensorContext(np.random.SeedSequence(seed, spawn_key=(1, 2))), **parameters)


def scenes(count):
    return [
        Scene(Indenter.single(), Pose(k % 7 - 3, k % 5 - 2, depth=0.05 * k)) for k in range(count)
    ]


def alike(one, two):
    return all(
        np.array_equal(a.image, b.image)
        and np.array_equal(a.rest, b.rest)
        and (a.timestamp, a.pose) == (b.timestamp, b.pose)
        for a, b in zip(one, two, strict=True)
    )


# -- which instance


@given(st.integers(2, 1000), st.integers(0, 2**63), st.integers(0, 10**6))
def test_reserved_instances_are_never_drawn(count, seed, press):
    drawn = TrainingInstances(None, np.random.SeedSequence(seed), count)
    number = drawn.number_of(press)
    assert 10 <= number < 10 + count
    again = TrainingInstances(None, np.random.SeedSequence(seed), count)
    assert again.number_of(press) == number


@pytest.mark.parametrize("count", [2, 3, 16])
def test_the_presses_are_spread_evenly_and_without_a_pattern(count):
    drawn = TrainingInstances(None, np.random.SeedSequence(5), count)
    numbers = np.array([drawn.number_of(press) for press in range(1600)])
    share = np.bincount(numbers - 10, minlength=count) / len(numbers)
    assert share == pytest.approx(1 / count, abs=4 * math.sqrt(1 / count / len(numbers)))
    same = np.mean(numbers[1:] == numbers[:-1])
    assert same == pytest.approx(1 / count, abs=4 * math.sqrt(1 / count / len(numbers)))


def test_batching_and_threads_change_no_frame():
    pressed = scenes(80)  # more than one batch
    frames = list(sensor(instances=4).press_many(pressed))
    with sensor(instances=4) as one:
        assert alike(frames, [one.press(scene) for scene in pressed])
    with sensor(instances=4, threads=3) as many:
        head = list(many.press_many(pressed[:30]))
        middle = [many.press(scene) for scene in pressed[30:33]]
        assert alike(frames, [*head, *middle, *many.press_many(pressed[33:])])
    with many:  # opened again it starts with the first press
        assert alike(frames[:5], many.press_many(pressed[:5]))


def test_a_scene_that_cannot_be_pressed_ends_the_presses_before_it_alone():
    pressed = scenes(9)
    wrong = Scene(Indenter.single(), Pose(depth=50.0))
    made = []
    with pytest.raises(UserError, match="depth is 50 mm"):
        made.extend(sensor(instances=4).press_many([*pressed, wrong, *pressed]))
    assert alike(made, sensor(instances=4).press_many(pressed))


def test_frames_are_those_of_the_instances_themselves():
    many, pressed = sensor(instances=3, noise=False), scenes(20)
    frames = list(many.press_many(pressed))
    drawn = set()
    for k, (scene, frame) in enumerate(zip(pressed, frames, strict=True)):
        number = many.instances.number_of(k)
        drawn.add(number)
        own = sensor(instance=number, ranges=2, noise=False)
        assert np.array_equal(frame.image, own.press(scene).image)
        assert np.array_equal(frame.rest, own.rest().image)
    assert drawn == {10, 11, 12}


def test_few_instances_in_memory_give_the_same_frames(monkeypatch):
    pressed = scenes(20)
    frames = list(sensor(instances=6).press_many(pressed))
    monkeypatch.setattr(training_instances, "KEPT", 1)
    assert alike(frames, sensor(instances=6).press_many(pressed))


# -- the rest frame


@pytest.mark.parametrize(
    "parameters", [{}, {"output": "rgb"}, {"pin_loss": 0.1}, {"kind": TacTip331}]
)
def test_every_instance_has_its_own_rest_frame_and_it_is_that_of_no_contact(parameters):
    many = sensor(instances=5, noise=False, **parameters)
    untouched = [Scene(Indenter.single(), Pose(depth=0.0))] * 30
    frames = list(many.press_many(untouched))
    by_instance = {many.instances.number_of(k): frame.rest for k, frame in enumerate(frames)}
    for k, frame in enumerate(frames):
        assert np.array_equal(frame.image, frame.rest)
        assert frame.rest is by_instance[many.instances.number_of(k)]  # shared, not copied
        assert not frame.rest.flags.writeable
    rests = {rest.tobytes() for rest in by_instance.values()}
    assert len(by_instance) == len(rests) == 5
    nominal = sensor(noise=False, **parameters).rest().image
    assert nominal.tobytes() not in rests
    assert np.array_equal(many.rest().image, nominal)


# -- one instance


@pytest.mark.parametrize("count", [0, 1])
def test_none_and_one_are_the_sensor_itself_bit_for_bit(count):
    plain, one = sensor(), sensor(instances=count)
    assert one.describe() == plain.describe()
    frames = list(one.press_many(scenes(10)))
    assert alike(frames, plain.press_many(scenes(10)))
    assert all(frame.rest is frames[0].rest for frame in frames)


def test_many_and_one_at_once_are_refused():
    with pytest.raises(UserError, match=r"leave one of them out, or test .* sensor.instance=3"):
        sensor(instance=3, instances=4)


@pytest.mark.parametrize(
    ("name", "given", "words"),
    [
        ("tactip-127", {"instances": "-1"}, "'instances' is -1; it must be >= 0"),
        ("tactip-331", {"instances": "1001"}, "'instances' is 1001; it must be <= 1000"),
        ("tactip-331", {"instances": "many"}, "'instances' is 'many', but must be a whole number"),
        ("tactip-127", {"ranges": "3"}, "'ranges' is 3; allowed: 1, 2"),
        ("planar-grid", {"instances": "4"}, "no parameter 'instances'"),
    ],
)
def test_a_bad_number_is_refused_in_one_sentence(name, given, words):
    with pytest.raises(UserError, match=words):
        PluginHost().sensors[name].settings(given)


def test_the_description_says_which_instances():
    told = sensor(instances=4).describe()["instances"]
    assert (told["count"], told["numbers"], told["ranges"]) == (4, [10, 13], 2)
    assert told["tolerances"] == dataclasses.asdict(TOLERANCES)
    assert told["domes"] == instances.shipped().digest
    assert json.loads(json.dumps(told)) == told
    assert sensor(instance=3, ranges=2).describe()["ranges"] == 2
    assert not {"instances", "ranges"} & set(sensor(instance=3).describe())


# -- the two versions of the ranges


@pytest.mark.parametrize("instance", range(1, 10))
def test_instances_of_stored_runs_are_what_they_were(instance):
    """Computed here from the formula with which those runs were made."""
    u = np.random.default_rng([instance, *b"optics"]).uniform(-1.0, 1.0, 12)
    optics, length = perturb(TACTIP_127.optics, 2.0, instance)
    assert optics.camera_distance_mm == 55.0 + u[0] * 0.5
    assert optics.roll_deg == u[3] * 2.0
    assert length == 2.0 + u[5] * 0.1
    assert optics.focal == 0.956 * (1 + u[8] * 0.02)
    assert optics.background == 16.0 * (1 + u[11] * 0.2)
    x, y = np.random.default_rng([instance, *b"dome"]).uniform(-1.0, 1.0, 2)
    assert dome_of(instance) == (x, y)


@given(st.integers(1, 10**9))
def test_an_instance_with_sources_is_within_its_tolerances(instance):
    nominal, wide = TACTIP_127.optics, TOLERANCES
    optics, length = perturb(nominal, 2.0, instance, ranges=2)
    assert (optics, length) == perturb(nominal, 2.0, instance, ranges=2)
    assert (optics, length) != perturb(nominal, 2.0, instance)
    assert abs(length - 2.0) <= wide.pin_length_mm
    for name in ("principal_x", "principal_y", "roll_deg", "marker_radius_mm", "edge_px"):
        assert 0 < abs(getattr(optics, name) - getattr(nominal, name)) <= getattr(wide, name)
    assert abs(optics.focal / nominal.focal - 1) <= wide.focal
    # more gel is a longer tip: beside the camera's seat the window keeps its place
    assert abs(optics.gel_mm - nominal.gel_mm) <= wide.fill_mm
    assert abs(optics.air_mm - nominal.air_mm) <= wide.seat_mm + 1e-9
    # the same LEDs light pins and gel
    light = optics.brightness / nominal.brightness
    assert abs(light - 1) <= wide.light
    assert abs(optics.background / nominal.background / light - 1) <= wide.background + 1e-12
    x, y = dome_of(instance, 2)
    assert max(abs(x), abs(y)) <= 1  # the tables reach no further
    assert abs(SKIN_FACTOR**y - 1) <= wide.skin_mm + 1e-12


@settings(max_examples=200)
@given(ENDS)
def test_no_instance_leaves_the_tables(shares):
    shares = dict.fromkeys([f.name for f in dataclasses.fields(Tolerances)], 1.0) | shares
    ratio, skin = dome_factors(shares)
    assert 1 / RATIO_FACTOR <= ratio <= RATIO_FACTOR
    assert 1 / SKIN_FACTOR <= skin <= SKIN_FACTOR


def test_modulus_follows_hardness_as_gent_says():
    """30 Shore A is 1.14 MPa, and five points of hardness are about a fifth of the modulus."""
    assert modulus(30) == pytest.approx(1.14, abs=0.01)
    assert modulus(25) / modulus(30) == pytest.approx(0.81, abs=0.01)
    assert modulus(35) / modulus(30) == pytest.approx(1.22, abs=0.01)
    assert modulus(0) == pytest.approx(0.0981 * 56 / (0.137505 * 254))


def test_nominal_stays_nominal_and_a_further_tolerance_disturbs_no_other(monkeypatch):
    assert perturb(TACTIP_127.optics, 2.0, 0, ranges=2) == (TACTIP_127.optics, 2.0)
    assert dome_of(0, 2) == (0.0, 0.0)
    before = instances._shares(12)
    fewer = [f for f in dataclasses.fields(Tolerances) if f.name != "seat_mm"]
    monkeypatch.setattr(instances, "fields", lambda _: fewer)
    assert instances._shares(12) == {k: v for k, v in before.items() if k != "seat_mm"}
    assert Tolerances() == TOLERANCES
