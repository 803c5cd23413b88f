"""The finite-element scenes that ship: the physics in them, and the sensor that shows them."""

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench.geometry import tip_depths, tip_positions, true_contacts
from tactibench_sim import (
    Reference127,
    Reference331,
    TacTip127,
    TacTip331,
    reference_scenes,
    scene_of,
    shipped_file,
)

SCENES = reference_scenes()


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
        assert scene.indenter.radius == 3.0, one.label


def test_scenes_are_told_apart_and_belong_to_runs(sensor):
    scenes, presses = sensor.scenes(), sensor.presses()
    assert len(scenes) == len(set(scenes.values())) == len(SCENES)
    assert set(presses) == set(scenes)
    assert [presses[f"p7_eq at {d} mm"] for d in (1, 6)] == ["p7_eq", "p7_eq"]
    alone = {presses[one.label] for one in SCENES if len(one.tips) == 1}
    assert alone == {"s_0", "s_5", "s_8", "s_12", "s20", "s40", "s55"}


@pytest.mark.parametrize("kind", [(Reference127, TacTip127), (Reference331, TacTip331)])
def test_frames_show_the_tips_of_the_runs_on_the_nominal_sensor(kind):
    """What the tables lack at the runs' own pins is known at the sensor's."""
    still = {"noise": False, "friction": 0.0}
    made, nominal = kind[0](context(), **still), kind[1](context(), **still)
    assert (made.rest().image == nominal.rest().image).all()
    length = nominal.pin_length
    for one in SCENES[::29]:
        frame = made.press(scene_of(one))
        assert (frame.rest == made.rest().image).all()
        loads = nominal.mechanics.loads(one.as_tips)
        lacking = 19.0 * one.directions + one.displacement - length * one.normals
        lacking -= nominal.mechanics.pin_tips(loads, one.directions, length)[0]
        changed = made.points([scene_of(one)]) - nominal.points([scene_of(one)])
        apart = np.arccos(np.clip(nominal.directions @ one.directions.T, -1, 1))
        beside = lacking[apart.argmin(axis=1)]  # within 1 mm
        assert np.median(abs(changed[0] - beside)) < 0.004
        assert abs(changed).max() < 2 * abs(lacking).max()


def test_a_scene_that_does_not_ship_is_refused(sensor):
    with pytest.raises(UserError, match="116 finite-element scenes that ship"):
        sensor.press(Scene(Indenter.single(), Pose(depth=1.1)))


def test_the_frames_identity_names_the_runs_and_the_optics(sensor):
    described = sensor.describe()
    assert described["reference"]["sha256"] == shipped_file("scenes.npz").digest
    assert not {"tier", "tables"} & set(described)
    brighter = Reference127(context(), brightness=180.0).describe()
    assert brighter["optics"] != described["optics"]
