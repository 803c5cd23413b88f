"""The finite-element scenes that ship: the physics in them, and the sensor that shows them."""

import math

import numpy as np
import pytest

from tactibench import Grid, Indenter, Pose, Scene, SensorContext, UserError
from tactibench.geometry import tip_depths, tip_positions, true_contacts
from tactibench_sim import (
    Reference127,
    Reference331,
    TacTip127,
    TacTip331,
    layout,
    reference_scenes,
    scene_of,
    shipped_file,
)

SCENES = reference_scenes()
PINS = np.concatenate([layout(331), layout(127)])


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
    """A pin's tip is its base less its length along the normal."""
    made, nominal = kind[0](context(), noise=False), kind[1](context(), noise=False)
    assert (made.rest().image == nominal.rest().image).all()
    for one in SCENES[::29]:
        rows = slice(331, 458) if kind[0] is Reference127 else slice(0, 331)
        tips = 19.0 * one.directions + one.displacement - 2.0 * one.normals
        frame = made.press(scene_of(one))
        assert (frame.image == nominal.renderer.frames(tips[None, rows])[0]).all()
        assert (frame.rest == made.rest().image).all()


def test_what_finite_elements_do_not_say_is_not_said(sensor):
    scene = scene_of(SCENES[0])
    assert sensor.bound(scene) is None
    assert sensor.surface(scene, Grid.centred(3, 1.0)) is None


def test_a_scene_that_does_not_ship_is_refused(sensor):
    with pytest.raises(UserError, match="116 finite-element scenes that ship"):
        sensor.press(Scene(Indenter.single(), Pose(depth=1.1)))


def test_the_frames_identity_names_the_runs_and_the_optics(sensor):
    described = sensor.describe()
    assert described["reference"]["sha256"] == shipped_file("scenes.npz").digest
    assert not {"tier", "tables"} & set(described)
    brighter = Reference127(context(), brightness=180.0).describe()
    assert brighter["optics"] != described["optics"]


def around_apex(scene):
    """Whether tips of one depth stand around the apex."""
    middle = abs(scene.tips[:, :2].mean(axis=0)).max()
    return middle < 1e-6 and np.ptp(scene.tips[:, 2]) < 1e-9


def elements_mm(depth):
    """What the mesh, which has no symmetry but y, may break of a symmetry of the scene."""
    return 0.012 + 0.003 * depth


def symmetric(scene, image, turn):
    off = np.linalg.norm(scene.displacement[image] - scene.displacement @ turn.T, axis=1)
    assert off.max() < elements_mm(scene.depth)
    assert np.median(off) < elements_mm(scene.depth) / 3
    bent = np.degrees(np.linalg.norm(scene.normals[image] - scene.normals @ turn.T, axis=1))
    assert bent.max() < 2.5
    assert np.median(bent) < 0.3


def nearest(directions):
    """Number of the pin of the same pattern at each direction, of all 458."""
    found = np.empty(len(PINS), dtype=int)
    for part in (slice(0, 331), slice(331, 458)):
        along = directions[part] @ PINS[part].T
        assert along.max(axis=1).min() > 1 - 1e-9
        found[part] = along.argmax(axis=1) + part.start
    return found


def test_every_scene_is_what_mechanics_demands():
    """Pins of today; unit normals outwards; deepest near a tip; a bulge; a mirror plane."""
    flip = np.array([1.0, -1.0, 1.0])
    image = nearest(PINS * flip)
    for scene in SCENES:
        u, normals, where = scene.displacement, scene.normals, scene.label
        assert scene.directions == pytest.approx(PINS, abs=1e-12), where
        assert np.linalg.norm(normals, axis=1) == pytest.approx(1, abs=1e-12), where
        assert ((normals * PINS).sum(axis=1) > 0.3).all(), where
        longest = np.linalg.norm(u, axis=1).max()
        assert 0.5 * scene.depth < longest < scene.depth, where
        inward = -(u * PINS).sum(axis=1)
        deepest = 19 * PINS[inward.argmax(), :2]
        assert min(math.dist(deepest, tip) for tip in scene.tips[:, :2]) < 3.0, where
        # the gel is incompressible: what tips push in comes out beside them
        assert inward.min() < -0.02 * scene.depth, where
        mirrored = {tuple(np.round(tip * flip, 9)) for tip in scene.tips}
        assert mirrored == {tuple(np.round(tip, 9)) for tip in scene.tips}, where
        assert u[image] == pytest.approx(u * flip, abs=1e-3), where
        assert normals[image] == pytest.approx(normals * flip, abs=2e-3), where


@pytest.mark.parametrize(
    "scene",
    [s for s in SCENES if len(s.tips) == 2 and around_apex(s) and not s.tips[0, 1]],
    ids=lambda s: s.label,
)
def test_an_equal_pair_is_the_same_from_behind(scene):
    flip = np.array([-1.0, 1.0, 1.0])
    image = nearest(PINS * flip)
    symmetric(scene, image, np.diag(flip))


@pytest.mark.parametrize(
    "scene",
    [s for s in SCENES if len(s.tips) == 3 and around_apex(s)],
    ids=lambda s: s.label,
)
def test_an_equal_triple_is_the_same_from_three_sides(scene):
    c, s = math.cos(2 * math.pi / 3), math.sin(2 * math.pi / 3)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    image = nearest(PINS @ turn.T)
    symmetric(scene, image, turn)
