"""The finite-element scenes that ship: the file, the physics in it, and how it is packed."""

import math
from importlib.resources import files

import numpy as np
import pytest
from pack_scenes import pack

from tactibench import UserError
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


def run(path, **changed):
    """A made-up run of two depths with a tip and its mirror image."""
    depth = np.array([1.0, 2.5])
    u = depth[:, None, None] * np.sin(3 * PINS + np.arange(3))
    near = (PINS[:, 2] > 0.8)[:, None]
    normals = PINS + near * 0.1 * depth[:, None, None] * np.cos(5 * PINS)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    arrays = {
        "d": depth,
        "tips": np.array([(2.0, 3.5, 1.0), (-5.0, 0.0, 0.5)]),
        "sym": True,
        "pu": u,
        "pn": normals,
    }
    np.savez(path, **{**arrays, **changed})
    return {**arrays, **changed}


def test_packing_keeps_what_a_run_says(tmp_path):
    made = run(tmp_path / "val_a.npz")
    run(tmp_path / "val_b.npz", sym=False)
    out = tmp_path / "scenes.npz"
    digest = pack([tmp_path / "val_b.npz", tmp_path / "val_a.npz"], out)
    found = reference.read(out)
    assert found.digest == digest
    assert [scene.label for scene in found.scenes] == [
        "a at 1 mm",
        "a at 2.5 mm",
        "b at 1 mm",
        "b at 2.5 mm",
    ]
    second, last = found.scenes[1], found.scenes[3]
    assert second.tips == pytest.approx(
        np.array([(2.0, 3.5, 2.5), (-5.0, 0.0, 1.25), (2.0, -3.5, 2.5)])
    )
    assert len(last.tips) == 2
    fair = abs(PINS[:, 1]) > 1e-9
    close, turned = reference.STEP_MM / 2 + 1e-12, 2 * reference.STEP_NORMAL
    assert second.displacement[fair] == pytest.approx(made["pu"][1][fair], abs=close)
    assert second.normals[fair] == pytest.approx(made["pn"][1][fair], abs=turned)
    assert (second.displacement[~fair, 1] == 0).all()
    assert last.displacement == pytest.approx(made["pu"][1], abs=close)
    assert last.normals == pytest.approx(made["pn"][1], abs=turned)
    assert second.as_tips.depth[0] == pytest.approx(second.tips[:, 2])
    assert not second.equal
    assert not second.on_apex


def test_packing_twice_gives_the_same_bytes(tmp_path):
    run(tmp_path / "val_a.npz")
    for name in ("one.npz", "two.npz"):
        pack([tmp_path / "val_a.npz"], tmp_path / name)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()


def test_packing_nothing_is_refused(tmp_path):
    with pytest.raises(UserError, match="no runs"):
        pack([], tmp_path / "scenes.npz")


def test_packing_a_file_that_is_being_written_is_refused(tmp_path):
    run(tmp_path / "val_a.npz")
    cut = tmp_path / "val_b.npz"
    cut.write_bytes((tmp_path / "val_a.npz").read_bytes()[:-200])
    with pytest.raises(UserError, match=r"val_b\.npz cannot be read"):
        pack([tmp_path / "val_a.npz", cut], tmp_path / "scenes.npz")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (lambda a: {"pu": a["pu"][:, :-1]}, "must be"),
        (lambda a: {"pn": a["pn"][:1]}, "must be"),
        (lambda a: {"pu": a["pu"] * np.where(np.arange(458) == 7, np.nan, 1)[:, None]}, "finite"),
        (lambda a: {"pu": a["pu"] * 10}, "more than the file can hold"),
        (lambda a: {"pn": a["pn"][:, ::-1]}, "other pins"),
    ],
    ids=["pins", "depths", "nan", "far", "order"],
)
def test_packing_refuses_what_is_no_run(tmp_path, changed, said):
    path = tmp_path / "val_a.npz"
    run(path, **changed(run(path)))
    with pytest.raises(UserError, match=said):
        pack([path], tmp_path / "scenes.npz")
    assert not (tmp_path / "scenes.npz").exists()
