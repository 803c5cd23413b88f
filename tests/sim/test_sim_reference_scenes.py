"""The finite-element scenes that ship: the file, and the physics in it."""

import math
from importlib.resources import files

import numpy as np
import pytest

from tactibench_sim.pins import layout
from tactibench_sim.reference_frames import scenes as reference

SHIPPED = files("tactibench_sim.reference_frames").joinpath(reference.FILE)
SCENES = reference.shipped()
PINS = np.concatenate([layout(331), layout(127)])


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


def test_file_is_small_and_holds_scenes():
    assert len(SHIPPED.read_bytes()) < 1_000_000
    assert len(SCENES) >= 5
    assert len({scene.label for scene in SCENES}) == len(SCENES)


def test_parameters_say_what_was_computed():
    told = reference.shipped_file().parameters
    assert told["dome"]["stiffness_ratio"] == 50
    assert told["solver"].startswith("ngsolve 6")
    assert set(told["runs"]) == {scene.name for scene in SCENES}


def test_every_scene_is_what_mechanics_demands():
    """Pins of today; unit normals outwards; deepest near a tip; a bulge; a mirror plane."""
    flip = np.array([1.0, -1.0, 1.0])
    image = nearest(PINS * flip)
    for scene in SCENES:
        u, normals, where = scene.displacement, scene.normals, scene.label
        assert scene.directions == pytest.approx(PINS, abs=1e-12), where
        assert not u.flags.writeable, where
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
    [s for s in SCENES if len(s.tips) == 2 and s.on_apex and s.equal and not s.tips[0, 1]],
    ids=lambda s: s.label,
)
def test_an_equal_pair_is_the_same_from_behind(scene):
    flip = np.array([-1.0, 1.0, 1.0])
    image = nearest(PINS * flip)
    symmetric(scene, image, np.diag(flip))


@pytest.mark.parametrize(
    "scene",
    [s for s in SCENES if len(s.tips) == 3 and s.on_apex and s.equal],
    ids=lambda s: s.label,
)
def test_an_equal_triple_is_the_same_from_three_sides(scene):
    c, s = math.cos(2 * math.pi / 3), math.sin(2 * math.pi / 3)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    image = nearest(PINS @ turn.T)
    symmetric(scene, image, turn)
