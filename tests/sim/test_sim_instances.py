"""Other sensors of the same make: domes between computed ones, draws, presses on many of them."""

import dataclasses
import math

import numpy as np
import pytest
from hard_scenes import enclosed_volume
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench_sim import (
    QUANTUM,
    RATIO_FACTOR,
    SKIN_FACTOR,
    TACTIPS,
    Optics,
    Spread,
    TableMechanics,
    TacTip127,
    Tips,
    Tolerances,
    TrainingInstances,
    dome_of,
    friction_shares,
    instance_friction,
    instance_tables,
    layout,
    lost_pins,
    modulus,
    perturb,
    shape_name,
    shipped_dome,
    shipped_file,
    tables_between,
)

NOMINAL, DOMES = shipped_dome(), shipped_file("domes.npz")
ALL = [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]
few = settings(max_examples=12)
anywhere = st.tuples(st.floats(-1, 1), st.floats(-1, 1))
FIELDS = ("w", "t", "omega", "w_outer", "t_outer")


def test_instance_0_is_the_nominal_table():
    assert dome_of(0) == (0.0, 0.0)
    assert instance_tables(NOMINAL, 0) is NOMINAL
    assert tables_between(NOMINAL, 0.0, 0.0) is NOMINAL


def test_domes_are_drawn_once_within_the_tables():
    drawn = np.array([dome_of(n) for n in range(1, 301)])
    assert dome_of(7) == dome_of(7)
    assert len(np.unique(drawn)) == drawn.size
    assert 0.8 < abs(drawn).max() <= 1


@pytest.mark.parametrize("radius", NOMINAL.by_radius)
@pytest.mark.parametrize("node", [n for n in ALL if n != (0, 0)])
def test_a_computed_dome_is_met(radius, node):
    one, base = tables_between(NOMINAL, *node).by_radius[radius], NOMINAL.by_radius[radius]
    shape, every = shape_name(radius), 2
    kept = {n: DOMES.arrays[f"{shape}_{n}"] * QUANTUM for n in FIELDS}
    kept["force"] = DOMES.arrays[f"{shape}_force"]
    for name in FIELDS:
        change = (one.fields[name] - base.fields[name])[::every, ::every]
        assert change == pytest.approx(kept[name][node[0] + 1, node[1] + 1], abs=1e-12)
    force = (one.fields["force"] - base.fields["force"])[::every]
    assert force == pytest.approx(kept["force"][node[0] + 1, node[1] + 1], abs=1e-12)


@few
@given(anywhere)
def test_what_mechanics_demands_holds_between_computed_domes(at):
    tables = tables_between(NOMINAL, *at)
    inner = 20.0 - tables.parameters["dome"]["skin"]
    for one in tables.by_radius.values():
        assert one.fields["force"][0] == 0
        assert (np.diff(one.fields["force"]) > 0).all()
        assert one.fields["w_outer"][:, 0] == pytest.approx(one.delta, abs=0.008)
        for name in FIELDS:
            assert (one.fields[name][0] == NOMINAL.by_radius[one.radius].fields[name][0]).all()
        for name in ("t", "omega", "t_outer"):
            assert abs(one.fields[name][:, 0]).max() < 1e-12
        for which, radius in (("", inner), ("_outer", 20.0)):
            start = enclosed_volume(radius, one.polar, 0 * one.polar, 0 * one.polar)
            for row in (8, 24, 48):
                w, t = one.fields[f"w{which}"][row], one.fields[f"t{which}"][row]
                dimple = start - enclosed_volume(radius, one.polar, np.maximum(w, 0), 0 * w)
                change = enclosed_volume(radius, one.polar, w, t) - start
                assert abs(change) < 0.01 * dimple


@pytest.mark.parametrize("tier", ["superpose", "coupled"])
def test_pins_stand_on_the_instances_own_skin(tier):
    tables = instance_tables(NOMINAL, 4)
    assert tables.corrections is NOMINAL.corrections
    dome, pins = TableMechanics(tables, tier), layout(127)
    none = dome.loads(Tips(np.zeros((1, 1, 2)), np.full((1, 1), -np.inf), np.full(1, 3.0)))
    skin = SKIN_FACTOR ** dome_of(4)[1]
    assert abs(skin - 1) > 0.02
    rest = dome.pin_tips(none, pins, 2.0)[0]
    assert np.linalg.norm(rest, axis=1) == pytest.approx(20.0 - skin - 2.0)
    deep = Tips(np.zeros((1, 1, 2)), np.full((1, 1), 4.0), np.full(1, 3.0))
    moved = [m.displacement(m.loads(deep), pins)[0] for m in (dome, TableMechanics(NOMINAL, tier))]
    assert 0.02 < abs(moved[0] - moved[1]).max() < 1.0
    told = sensor(instance=4).describe()["tables"]
    assert told["sha256"] == tables.digest
    assert told["dome"]["skin"] == pytest.approx(skin)


# -- presses on many of them


def sensor(seed=3, kind=TacTip127, **parameters):
    parameters = {"size": 64} | parameters
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


@few
@given(st.integers(2, 1000), st.integers(0, 2**63), st.integers(0, 10**6))
def test_reserved_instances_are_never_drawn(count, seed, press):
    drawn = TrainingInstances(None, np.random.SeedSequence(seed), count)
    number = drawn.number_of(press)
    assert 10 <= number < 10 + count
    again = TrainingInstances(None, np.random.SeedSequence(seed), count)
    assert again.number_of(press) == number


@pytest.mark.parametrize("count", [2, 16])
def test_the_presses_are_spread_evenly_and_without_a_pattern(count):
    drawn = TrainingInstances(None, np.random.SeedSequence(5), count)
    numbers = np.array([drawn.number_of(press) for press in range(1600)])
    share = np.bincount(numbers - 10, minlength=count) / len(numbers)
    assert share == pytest.approx(1 / count, abs=4 * math.sqrt(1 / count / len(numbers)))
    same = np.mean(numbers[1:] == numbers[:-1])
    assert same == pytest.approx(1 / count, abs=4 * math.sqrt(1 / count / len(numbers)))


def test_frames_are_those_of_the_instances_themselves():
    still = {"noise": False, "friction_within": 0.0}
    many, pressed = sensor(instances=3, **still), scenes(20)
    frames = list(many.press_many(pressed))
    drawn = set()
    for k, (scene, frame) in enumerate(zip(pressed, frames, strict=True)):
        number = many.instances.number_of(k)
        drawn.add(number)
        own = sensor(instance=number, **still)
        assert np.array_equal(frame.image, own.press(scene).image)
        assert np.array_equal(frame.rest, own.rest().image)
    assert drawn == {10, 11, 12}


def test_few_instances_in_memory_give_the_same_frames(monkeypatch):
    pressed = scenes(20)
    frames = list(sensor(instances=6).press_many(pressed))
    monkeypatch.setattr("tactibench_sim.instances.KEPT", 1)
    assert alike(frames, sensor(instances=6).press_many(pressed))


# -- the rest frame


@pytest.mark.parametrize("parameters", [{}, {"output": "rgb", "pin_loss": 0.1}])
def test_every_instance_has_its_own_rest_frame_and_it_is_that_of_no_contact(parameters):
    many = sensor(instances=3, noise=False, **parameters)
    untouched = [Scene(Indenter.single(), Pose(depth=0.0))] * 15
    frames = list(many.press_many(untouched))
    by_instance = {many.instances.number_of(k): frame.rest for k, frame in enumerate(frames)}
    for k, frame in enumerate(frames):
        assert np.array_equal(frame.image, frame.rest)
        assert frame.rest is by_instance[many.instances.number_of(k)]  # shared, not copied
        assert not frame.rest.flags.writeable
    rests = {rest.tobytes() for rest in by_instance.values()}
    assert len(by_instance) == len(rests) == 3
    nominal = sensor(noise=False, **parameters).rest().image
    assert nominal.tobytes() not in rests
    assert np.array_equal(many.rest().image, nominal)


def test_one_is_the_sensor_itself_bit_for_bit():
    plain, one = sensor(), sensor(instances=1)
    assert one.describe() == plain.describe()
    assert alike(one.press_many(scenes(10)), plain.press_many(scenes(10)))


def test_many_and_one_at_once_are_refused():
    with pytest.raises(UserError, match=r"sensor.instance=3 and sensor.instances=4 name different"):
        sensor(instance=3, instances=4)


# -- the ranges


@given(st.sampled_from(sorted(TACTIPS)), st.integers(1, 9))
def test_a_test_instance_is_within_the_assumed_ranges_and_always_the_same(pins, instance):
    preset, spread = TACTIPS[pins], Spread()
    nominal, lever = preset.optics, preset.pin_length_mm
    optics, length = perturb(nominal, lever, instance)
    assert (optics, length) == perturb(nominal, lever, instance)
    assert 0.1 * lever <= length <= lever + spread.pin_length_mm
    relative = {"air_mm", "focal", "marker_radius_mm", "brightness", "background"}
    touched = {f.name for f in dataclasses.fields(Spread)} - {"pin_length_mm"}
    for name in touched:
        was, now = getattr(nominal, name), getattr(optics, name)
        by = getattr(spread, name) * (was if name in relative else 1)
        assert 0 < abs(now - was) <= by + 1e-12
    for field in dataclasses.fields(Optics):
        if field.name not in {*touched, "camera_distance_mm"}:
            assert getattr(optics, field.name) == getattr(nominal, field.name)
    x, y = np.random.default_rng([instance, *b"dome"]).uniform(-1.0, 1.0, 2)
    assert dome_of(instance) == (x, y)


@few
@given(st.sampled_from(sorted(TACTIPS)), st.integers(10, 10**9))
def test_a_training_instance_is_within_its_tolerances(pins, instance):
    preset, wide = TACTIPS[pins], Tolerances()
    nominal, lever = preset.optics, preset.pin_length_mm
    optics, length = perturb(nominal, lever, instance)
    assert (optics, length) == perturb(nominal, lever, instance)
    assert 0.1 * lever <= length <= lever + wide.pin_length_mm
    for name in ("principal_x", "principal_y", "roll_deg", "marker_radius_mm", "edge_px"):
        assert 0 < abs(getattr(optics, name) - getattr(nominal, name)) <= getattr(wide, name)
    assert abs(optics.focal / nominal.focal - 1) <= wide.focal
    # more gel is a longer tip: the window keeps its place beside the camera
    assert abs(optics.gel_mm - nominal.gel_mm) <= wide.fill_mm
    assert abs(optics.air_mm / nominal.air_mm - 1) <= wide.air + 1e-9
    # the same LEDs light pins and gel
    light = optics.brightness / nominal.brightness
    assert abs(light - 1) <= wide.light
    assert abs(optics.background / nominal.background / light - 1) <= wide.background + 1e-12
    x, y = dome_of(instance)
    assert max(abs(x), abs(y)) <= 1  # the tables reach no further
    assert abs(SKIN_FACTOR**y - 1) <= wide.skin_mm + 1e-12


def test_levers_of_instances_reach_what_fits_to_parts_of_a_recording_find():
    nominal = TACTIPS[331]
    levers = [perturb(nominal.optics, nominal.pin_length_mm, n)[1] for n in range(10, 400)]
    assert min(levers) < 0.15
    assert max(levers) > 0.47


# -- friction


def test_friction_of_a_press_has_mean_1_and_the_stated_deviation():
    shares = friction_shares(np.random.SeedSequence(5), 0.2, 0, 100_000)
    assert shares.mean() == pytest.approx(1.0, abs=0.003)
    assert shares.std() == pytest.approx(0.2, abs=0.002)
    assert abs(np.corrcoef(shares[:-1], shares[1:])[0, 1]) < 0.015
    some = friction_shares(np.random.SeedSequence(5), 0.2, 70, 9)
    assert (some == shares[70:79]).all()
    assert (friction_shares(np.random.SeedSequence(6), 0.2, 0, 9) != shares[:9]).all()


def test_instances_have_friction_within_a_factor_and_the_nominal_one_has_the_nominal():
    assert instance_friction(0.5, 1.5, 0) == 0.5
    drawn = np.array([instance_friction(0.5, 1.5, n) for n in range(1, 400)])
    assert 0.5 / 1.5 <= drawn.min() < 0.36
    assert 0.71 < drawn.max() <= 0.75
    assert np.log(drawn / 0.5).mean() == pytest.approx(0.0, abs=0.03)
    assert instance_friction(0.5, 1.0, 7) == 0.5
    assert sensor(instance=3).mechanics.friction == instance_friction(0.5, 1.5, 3)
    assert sensor(instance=3).describe()["friction"] == instance_friction(0.5, 1.5, 3)


@pytest.mark.parametrize("parameters", [{}, {"instance": 2}, {"instances": 3}])
def test_presses_of_one_scene_differ_by_their_own_friction_alone(parameters):
    still = {"noise": False, "size": 128} | parameters
    off_apex = Scene(Indenter.single(), Pose(x=6.0, depth=3.0))
    drawn = list(sensor(**still).press_many([off_apex] * 70))
    again = [sensor(**still).press(off_apex)]
    alone = sensor(**still)
    again += [alone.press(off_apex) for _ in range(2)]
    assert alike(drawn[:1], again[:1])
    assert alike(drawn[:2], again[1:])
    images = {frame.image.tobytes() for frame in drawn}
    assert len(images) > 60
    fixed = [
        frame.image.tobytes()
        for frame in sensor(**still, friction_within=0.0).press_many([off_apex] * 70)
    ]
    assert len(set(fixed)) == (3 if "instances" in parameters else 1)


def test_without_friction_nothing_of_it_is_made():
    import subprocess
    import sys

    code = (
        "import sys, numpy as np; from tactibench import *; from tactibench_sim import TacTip127;"
        "one = TacTip127(SensorContext(np.random.SeedSequence(0)), friction=0.0);"
        "one.press(Scene(Indenter.single(), Pose(x=6.0, depth=3.0)));"
        "sys.exit('tactibench_sim.friction' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    told = sensor(friction=0.0).describe()
    assert not [name for name in told if name.startswith("friction")]


def test_the_ends_of_the_tolerances_stay_within_the_tables():
    wide = Tolerances()
    for sign in (-1, 1):
        skin = modulus(30 + sign * wide.hardness) / modulus(30)
        ratio = skin * wide.gel**sign
        assert 1 / RATIO_FACTOR <= ratio <= RATIO_FACTOR
        assert 1 / SKIN_FACTOR <= 1 + sign * wide.skin_mm <= SKIN_FACTOR


@few
@given(st.integers(0, 1000), st.floats(0, 0.9))
def test_lost_pins_are_the_instances(instance, share):
    lost = lost_pins(127, share, instance)
    assert lost.sum() == round(127 * share)
    assert (lost == lost_pins(127, share, instance)).all()
    assert (lost <= lost_pins(127, min(1.0, share + 0.1), instance)).all()
    if share > 0.1:
        assert (lost != lost_pins(127, share, instance + 1)).any()


def test_modulus_follows_hardness_as_gent_says():
    """30 Shore A is 1.14 MPa, and five points of hardness are about a fifth of the modulus."""
    assert modulus(30) == pytest.approx(1.14, abs=0.01)
    assert modulus(25) / modulus(30) == pytest.approx(0.81, abs=0.01)
    assert modulus(35) / modulus(30) == pytest.approx(1.22, abs=0.01)
