"""The finite-element scenes as a sensor: scenes that ship, seen by the camera."""

import numpy as np
import pytest

from tactibench import Grid, Indenter, Pose, Scene, SensorContext, UserError
from tactibench.geometry import tip_depths, tip_positions, true_contacts
from tactibench_sim import hooks
from tactibench_sim.reference_frames import frames as validate_frames
from tactibench_sim.reference_frames import scenes as reference
from tactibench_sim.reference_frames.hooks import tactibench_sensors
from tactibench_sim.reference_frames.sensor import Reference127, Reference331, press_of, scene_of
from tactibench_sim.sensor import TacTip127, TacTip331

SCENES = reference.shipped()


def context(seed=0):
    return SensorContext(np.random.SeedSequence(seed))


@pytest.fixture(scope="module")
def sensor():
    return Reference127(context())


def test_a_scene_brings_every_tip_where_the_run_had_it():
    for one in SCENES:
        scene = scene_of(one)
        assert np.allclose(tip_positions(scene)[:, :2], one.tips[:, :2], atol=1e-12), one.label
        assert np.allclose(tip_depths(scene), one.tips[:, 2], atol=1e-12), one.label
        assert len(true_contacts(scene)) == len(one.tips), one.label
        assert scene.indenter.radius == reference.RADIUS_MM, one.label


def test_scenes_are_told_apart_and_belong_to_runs(sensor):
    scenes, presses = sensor.scenes(), sensor.presses()
    assert len(scenes) == len(set(scenes.values())) == len(SCENES)
    assert set(presses) == set(scenes)
    assert [presses[f"p7_eq at {d} mm"] for d in (1, 6)] == ["p7_eq", "p7_eq"]
    alone = {press_of(one) for one in SCENES if len(one.tips) == 1}
    assert alone == {"s_0", "s_5", "s_8", "s_12", "s20", "s40", "s55"}


@pytest.mark.parametrize("kind", [(Reference127, TacTip127), (Reference331, TacTip331)])
def test_frames_and_rest_are_those_of_the_nominal_sensor(kind):
    made, nominal = kind[0](context(), noise=False), kind[1](context(), noise=False)
    assert (made.rest().image == nominal.rest().image).all()
    few = SCENES[::29]
    expected = validate_frames.frames(nominal, few, np.random.SeedSequence(0))
    with made:
        for frame, image, one in zip(
            made.press_many([scene_of(one) for one in few]), expected, few, strict=True
        ):
            assert (frame.image == image).all()
            assert (frame.rest == made.rest().image).all()
            assert frame.pose == scene_of(one).pose


def test_noise_follows_the_seed():
    scene = scene_of(SCENES[0])
    first, again, other = (Reference127(context(seed)).press(scene).image for seed in (0, 0, 1))
    assert (first == again).all()
    assert (first != other).any()


def test_what_finite_elements_do_not_say_is_not_said(sensor):
    scene = scene_of(SCENES[0])
    assert sensor.bound(scene) is None
    assert sensor.surface(scene, Grid.centred(3, 1.0)) is None


def test_a_scene_that_does_not_ship_is_refused(sensor):
    with pytest.raises(UserError, match="116 finite-element scenes that ship"):
        sensor.press(Scene(Indenter.single(), Pose(depth=1.1)))


@pytest.mark.parametrize("other", [{"instance": 1}, {"table": "mine.npz"}])
def test_another_dome_is_refused(other):
    with pytest.raises(UserError, match="of the nominal dome, and sensor"):
        Reference127(context(), **other)


def test_the_frames_identity_names_the_runs_and_the_optics(sensor):
    described = sensor.describe()
    assert described["reference"]["sha256"] == reference.shipped_file().digest
    assert not {"tier", "tables"} & set(described)
    brighter = Reference127(context(), brightness=180.0).describe()
    assert brighter["optics"] != described["optics"]


def test_declared_beside_the_sensors_they_belong_to():
    simulated = {spec.name: spec for spec in hooks.tactibench_sensors()}
    declared = tactibench_sensors()
    assert {spec.reference_of for spec in declared} == {"tactip-127", "tactip-331"}
    for spec in declared:
        assert issubclass(spec.load(), (Reference127, Reference331))
        names = {p.name for p in spec.parameters}
        nominal = {p.name for p in simulated[spec.reference_of].parameters}
        assert nominal - names == {"tier"}


def test_pins_of_another_version_have_no_reference():
    other = Reference331(context(), version=2)
    with pytest.raises(UserError, match="take version 1"):
        other.press(next(iter(other.scenes().values())))
