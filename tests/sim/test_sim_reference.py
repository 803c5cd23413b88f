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
    return Reference127(context(), friction=0.0)


def test_a_scene_brings_every_tip_where_the_run_had_it():
    for one in SCENES:
        scene = scene_of(one)
        assert np.allclose(tip_positions(scene)[:, :2], one.tips[:, :2], atol=1e-12), one.label
        assert np.allclose(tip_depths(scene), one.tips[:, 2], atol=1e-12), one.label
        assert len(true_contacts(scene)) == len(one.tips), one.label
        assert scene.indenter.radius == 3.0, one.label


def test_scenes_are_told_apart_and_belong_to_runs(sensor):
    scenes, presses = sensor.scenes(), sensor.presses()
    smooth = [one for one in SCENES if not one.friction]
    assert len(scenes) == len(set(scenes.values())) == len(smooth)
    assert set(presses) == set(scenes)
    assert [presses[f"p7_eq at {d} mm"] for d in (1, 6)] == ["p7_eq", "p7_eq"]
    alone = {presses[one.label] for one in smooth if len(one.tips) == 1}
    assert alone == {"s_0", "s_5", "s_8", "s_12", "s20", "s40", "s55"}


@pytest.mark.parametrize("kind", [(Reference127, TacTip127), (Reference331, TacTip331)])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_frames_show_the_tips_of_the_runs_on_the_nominal_sensor(kind, friction):
    """A pin's tip is its base less its length along the normal."""
    made, nominal = (one(context(), noise=False, friction=friction) for one in kind)
    assert (made.rest().image == nominal.rest().image).all()
    for one in [one for one in SCENES if bool(one.friction) == bool(friction)][::29]:
        rows = slice(331, 458) if kind[0] is Reference127 else slice(0, 331)
        tips = 19.0 * one.directions + one.displacement - nominal.pin_length * one.normals
        frame = made.press(scene_of(one))
        assert (frame.image == nominal.renderer.frames(tips[None, rows])[0]).all()
        assert (frame.rest == made.rest().image).all()


def test_a_sensor_with_friction_has_the_scenes_with_friction():
    rubbing = Reference127(context())
    assert set(rubbing.scenes()) == {one.label for one in SCENES if one.friction}
    assert all(one.as_tips.friction == one.friction for one in SCENES if one.friction)


def test_a_scene_that_does_not_ship_is_refused(sensor):
    with pytest.raises(UserError, match="finite-element scenes without friction that ship"):
        sensor.press(Scene(Indenter.single(), Pose(depth=1.1)))


def test_the_frames_identity_names_the_runs_and_the_optics(sensor):
    described = sensor.describe()
    assert described["reference"]["sha256"] == shipped_file("scenes.npz").digest
    assert not {"tier", "tables"} & set(described)
    brighter = Reference127(context(), brightness=180.0).describe()
    assert brighter["optics"] != described["optics"]
