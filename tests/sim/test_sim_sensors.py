"""What every simulated sensor keeps: order, threads, seeds, noise, descriptions, parameters."""

import json
import math
import os
import subprocess
import sys

import numpy as np
import pytest

from tactibench import Grid, Indenter, Pose, Scene, SensorContext, UserError, gray_frames
from tactibench_sim import Reference127
from tactibench_sim.hooks import tactibench_sensors

RATE = 30.0
SPECS = {spec.name: spec for spec in tactibench_sensors()}
CASES = {
    "tactip-127": {},
    "tactip-331": {"tier": "superpose"},
    "many instances": {"instances": 4},
    "planar-grid": {},
    "fitted-127": {"spread": 1.0, "individuals": 3},
    "fitted-331": {"output": "bw"},
    "tactip-127-fem": {},
}
"""Sensor, or words for tactip-127 -> parameters."""


def made(case, seed=7, threads=1, **parameters):
    spec = SPECS.get(case, SPECS["tactip-127"])
    given = {"size": 64} | CASES.get(case, {}) | parameters
    sensor = spec.build(SensorContext(np.random.SeedSequence(seed)), **given)
    sensor.threads = threads or sensor.threads
    return sensor


def scenes(case, count, seed=0):
    if case.endswith("-fem"):
        listed = list(made(case).scenes().values())
        return [listed[k % len(listed)] for k in range(count)]
    rng = np.random.default_rng(seed)
    kinds = [Indenter.single(), Indenter.dual(7.0), Indenter.triple((0.0, 1.0, 2.0))]
    if case == "planar-grid":
        plate, deepest = kinds[0], 2.9
    else:
        plate, deepest = Indenter.plate(), 5.0
    out = []
    for k in range(count):
        indenter = [*kinds, plate][k % 4]
        tilt = 8.0 if indenter.is_plate else 0.0
        x, y = (0.0, 0.0) if indenter.is_plate else rng.uniform(-3, 3, 2)
        yaw, depth = rng.uniform(-180, 180), rng.uniform(0.5, deepest)
        out.append(Scene(indenter, Pose(x, y, yaw, tilt, depth)))
    return out


def images(frames):
    return np.stack([frame.image for frame in frames])


def rests(frames):
    return np.stack([frame.rest for frame in frames])


@pytest.fixture(params=CASES)
def case(request):
    return request.param


def test_grouping_and_threads_do_not_matter(case):
    several = scenes(case, 80)
    with made(case) as one, made(case, threads=3) as many, made(case) as mixed:
        single = [one.press(scene) for scene in several]
        batch = list(many.press_many(several))
        start = mixed.press_many(several[:40])
        some = [next(start) for _ in range(5)]
        some += [mixed.press(scene) for scene in several[5:20]]
        some += list(mixed.press_many(iter(several[20:])))
    for other in (batch, some):
        assert (images(single) == images(other)).all()
        assert (rests(single) == rests(other)).all()
    assert [f.timestamp for f in single] == [f.timestamp for f in batch]
    assert all(frame.pose is scene.pose for frame, scene in zip(batch, several, strict=True))


def test_same_seed_same_frames_other_seed_other_noise(case):
    several = scenes(case, 5)
    first = images(made(case).press_many(several))
    assert (images(made(case).press_many(several)) == first).all()
    assert (images(made(case, 8).press_many(several)) != first).any()
    again = made(case)
    list(again.press_many(several))
    with again:  # opened again it starts with the first press
        assert (images(again.press_many(several)) == first).all()
    assert list(again.press_many([])) == []


@pytest.mark.parametrize("threads", [1, 2])
def test_a_consumer_that_stops_has_pressed_what_it_took(threads):
    several, asked = scenes("tactip-127", 400), 0

    def source():
        nonlocal asked
        for scene in several:
            asked += 1
            yield scene

    one, plain = made("tactip-127", threads=threads), made("tactip-127")
    running = one.press_many(source())
    first = [next(running) for _ in range(3)]
    assert asked <= (threads + 1) * 64  # presses of a batch
    running.close()
    frames = [*first, one.press(several[3])]
    assert (images(frames) == images(map(plain.press, several[:4]))).all()
    assert frames[-1].timestamp == pytest.approx(4 / RATE)
    assert first[0].image.flags.owndata  # a kept frame does not keep its batch


def test_frames_before_a_bad_scene_come_first(case):
    place = 66  # in the second batch
    good, bad = scenes(case, place), Scene(Indenter.single(), Pose(depth=-1.0))
    seen, one = [], made(case, threads=2)
    with pytest.raises(UserError) as caught:
        seen.extend(one.press_many([*good, bad, *good]))
    assert str(caught.value).endswith((".", "--test reference."))
    assert len(seen) == place
    assert (images(seen) == images(made(case).press_many(good))).all()
    assert one.press(good[0]).timestamp == pytest.approx((place + 1) / RATE)


def test_untouched_is_rest_bit_for_bit(case):
    if case.endswith("-fem"):
        pytest.skip("every scene touches")
    one = made(case, **({} if case.startswith("fitted") else {"noise": False}))
    for indenter in (Indenter.single(), Indenter.dual(7.0)):
        untouched = Scene(indenter, Pose(depth=0.0))
        frame, surface = one.press(untouched), one.surface(untouched, Grid.centred(9, 2.0))
        assert surface is None or not surface.any()
        if case.startswith("fitted"):
            assert not one.moved([Scene(Indenter.plate(), Pose(depth=0.0))]).any()
        else:
            assert (frame.image == frame.rest).all()
    assert not one.rest().image.flags.writeable


def test_outputs(case):
    for output, shape in (("grey", (64, 64)), ("rgb", (64, 64, 3)), ("bw", (64, 64))):
        one = made(case, output=output, glare=1.0)
        frame = one.press(scenes(case, 1)[0])
        assert frame.image.shape == one.rest().image.shape == shape
        assert frame.image.dtype == np.uint8
        assert gray_frames([frame], 64).shape == (1, 64, 64)
        assert (set(np.unique(frame.image)) == {0, 255}) == (output == "bw")


def test_describe_is_json_and_tells_sensors_apart(case):
    one = made(case).describe()
    assert json.loads(json.dumps(one, allow_nan=False)) == json.loads(json.dumps(one))
    others = [{"size": 96}, {"output": "rgb"}, {"glare": 0.5}]
    if case.startswith("tactip"):
        others += [{"pin_length": 1.5}, {"brightness": 150.0}, {"pin_loss": 0.1}]
    if case in ("tactip-127", "planar-grid"):
        others += [{"tier": "superpose"}, {"instance": 1}, {"instance": 2}]
    if case == "tactip-127":
        others += [{"friction": 0.4}, {"friction": 0.0}, {"friction_within": 0.0}]
        others += [{"friction_between": 2.0}, {"instances": 4}, {"instances": 5}]
    if case.startswith("fitted"):
        others += [{"drag": 1.0}, {"dragged": 0.1}, {"spread": 2.0}]
    texts = {json.dumps(made(case, **other).describe(), sort_keys=True) for other in others}
    assert len(texts | {json.dumps(one, sort_keys=True)}) == len(others) + 1


@pytest.mark.parametrize("name", SPECS)
def test_the_specs_fit_the_classes(name):
    spec = SPECS[name]
    built = spec.build(SensorContext(np.random.SeedSequence(0)), **spec.settings({}))
    assert built.describe() == spec.build(SensorContext(np.random.SeedSequence(0))).describe()
    assert spec.name == built.describe()["sensor"]


BAD_VALUES = {
    "friction": (-1, math.nan, "0.5", 3.0),
    "pin_length": (-5, 10.0, math.inf),
    "instance": (-1, 0.5, True, None),
    "instances": (-1, 1001),
    "tier": ("none", 1),
    "size": (8, 64.5, "64"),
    "focal": (math.nan, 0.0),
    "background": (-1.0, 255.0),
    "noise": ("yes", 1),
    "spread": (-0.1, 9),
    "dragged": (1.5,),
    "glare": (-1, math.nan),
    "unheard_of": (1,),
}


@pytest.mark.parametrize("name", SPECS)
def test_python_is_refused_what_the_command_line_is_refused(name):
    """Through the class itself, and through the spec, by which plugins and runs build it."""
    spec, context = SPECS[name], SensorContext(np.random.SeedSequence(0))
    known = {parameter.name for parameter in spec.parameters}
    for parameter, values in BAD_VALUES.items():
        for value in values:
            match = f"'{parameter}' is " if parameter in known else f"no parameter '{parameter}'"
            for build in (spec.build, spec.load()):
                with pytest.raises(UserError, match=match):
                    build(context, **{parameter: value})


def test_scenes_of_finite_elements_belong_to_the_tactips():
    for name in ("tactip-127", "tactip-331"):
        beside = SPECS[f"{name}-fem"]
        assert beside.reference_of == name
        known = {p.name for p in SPECS[name].parameters}
        lacking = known - {p.name for p in beside.parameters}
        assert lacking == {"tier", "friction_between", "friction_within", "modulus"}
    for other in ({"instance": 1}, {"table": "mine.npz"}):
        with pytest.raises(UserError, match="of the nominal dome, and sensor"):
            Reference127(SensorContext(np.random.SeedSequence(0)), **other)


def test_hooks_are_light():
    code = (
        "import sys, tactibench_sim.hooks as h; h.tactibench_sensors();"
        "sys.exit(bool({'numpy', 'numba', 'click', 'scipy'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_threads_can_be_limited_from_outside(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert made("planar-grid", threads=None).threads == 3
    for nonsense in ("", "0", "many", "2,1"):
        monkeypatch.setenv("OMP_NUM_THREADS", nonsense)
        assert made("planar-grid", threads=None).threads >= 1


def test_compiled_loops_follow_the_cache_where_the_package_cannot_be_written(tmp_path):
    for writable, expected in ((False, str(tmp_path / "numba")), (True, "None")):
        code = (
            f"import os; os.access = lambda *_: {writable}; import tactibench;"
            "print(os.environ.get('NUMBA_CACHE_DIR'))"
        )
        env = {**os.environ, "TACTIBENCH_CACHE": str(tmp_path)}
        done = subprocess.run(
            [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
        )
        assert done.stdout.strip() == expected
