"""Error bounds of tier ``coupled``: those that ship are what tables and reference scenes give."""

from dataclasses import fields, replace
from itertools import combinations

import numpy as np
import pytest
from error_bounds import measured
from other_scenes import OTHER_TIPS

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench_sim import (
    RADIUS_MM,
    Bounds,
    Reference127,
    TableMechanics,
    TacTip127,
    TacTip331,
    Tips,
    envelope_terms,
    reference_scenes,
    scene_bounds,
    shipped_bounds,
    shipped_dome,
    shipped_file,
    tips_of,
)

pytestmark = pytest.mark.long

TABLES, SCENES = shipped_dome(), reference_scenes()
OTHERS = OTHER_TIPS
SINGLE, DUAL, TRIPLE = Indenter.single(), Indenter.dual(8.0), Indenter.triple((0, 1, 0.5))


def sensor(kind=TacTip127, **parameters):
    return kind(SensorContext(np.random.SeedSequence(0)), **parameters)


def of(tips, digest=TABLES.digest):
    return scene_bounds("coupled", digest, tips)


def bounds_of(*scenes, **more):
    return of(tips_of(scenes), **more)


@pytest.fixture(scope="module")
def bounds():
    return measured(TABLES, (*SCENES, *OTHERS))


def test_the_bounds_that_ship_are_measured_and_of_the_tables_that_ship(bounds):
    digest, tips, stored = shipped_bounds()
    assert (digest, tips) == (TABLES.digest, shipped_file("tips.npz").digest)
    envelopes = [(getattr(stored, name), getattr(bounds, name)) for name in ("pair", "many")]
    for one, other in zip(stored.others, bounds.others, strict=True):
        assert (one.smallest, one.largest) == (other.smallest, other.largest)
        envelopes += [(one.single, other.single), (one.pair, other.pair)]
    for old, new in envelopes:
        assert old.coefficients == pytest.approx(new.coefficients, abs=2e-6)
        assert (old.coefficients >= new.coefficients - 1e-9).all()
        for name in ("factor", "deepest", "nearest", "farthest", "lowest"):
            assert getattr(old, name) == pytest.approx(getattr(new, name), abs=1e-4)
    for field in fields(Bounds):
        old, new = getattr(stored, field.name), getattr(bounds, field.name)
        if isinstance(old, np.ndarray):
            assert old == pytest.approx(new, abs=1.1e-4), field.name
            assert (old >= new - 1e-6).all(), field.name  # rounded up


def test_no_reference_scene_is_worse_than_its_bound():
    mechanics = TableMechanics(TABLES, "coupled", other_tips=True)
    for scene in (*SCENES, *OTHERS):
        u, _ = mechanics.displacement(mechanics.loads(scene.as_tips), scene.directions)
        error = np.linalg.norm(u[0] - scene.displacement, axis=1).max()
        bound = of(scene.as_tips)[0]
        assert error <= bound, scene.name
        assert scene.radius == RADIUS_MM or bound < 0.2, scene.name


def test_envelope_terms_are_those_of_the_formula():
    rng = np.random.default_rng(1)
    n = rng.normal(size=(20, 3, 3)) + np.array([0.0, 0.0, 4.0])
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    depth = np.maximum(rng.uniform(-1, 5, (20, 3)), 0)
    for terms, tips, d in zip(envelope_terms(n, depth), n, depth, strict=True):
        first, second = sorted(d)[:0:-1]
        rim = 0.0
        for i, j in combinations(range(3), 2):
            beta = np.arccos((tips[i] + tips[j])[2] / np.linalg.norm(tips[i] + tips[j]))
            rim += np.sin(beta) ** 2 * max(d[i], d[j]) ** 2 * min(d[i], d[j])
        assert terms == pytest.approx([first, second, second**2, rim], abs=1e-12)


def test_tips_that_do_not_touch_change_no_bound():
    far = Indenter(3.0, ((0, 0, 0), (8, 0, -9)), "custom")
    turned = Scene(DUAL, Pose(2, 1, 200, 0, 3))
    assert bounds_of(Scene(far, Pose(depth=3))) == bounds_of(Scene(SINGLE, Pose(depth=3)))
    assert bounds_of(turned) == pytest.approx(bounds_of(Scene(DUAL, Pose(2, 1, 20, 0, 3))))
    assert bounds_of(Scene(DUAL, Pose()))[0] == 0.0  # the rest frame


@pytest.mark.parametrize(
    ("indenter", "pose"),
    [
        (Indenter.plate(), Pose(depth=1)),
        (SINGLE, Pose(depth=6.4)),
        (SINGLE, Pose(18.0, 0, depth=6)),  # 51 deg off, measured to 3 mm
        (Indenter.dual(5.0), Pose(depth=1)),
        (Indenter.dual(16.0), Pose(depth=1)),
        (DUAL, Pose(depth=6.3)),
        (DUAL, Pose(17.0, 0, 90, depth=3)),  # 51 deg off, both tips touch
        (Indenter(3.0, ((-8, 0, 1.4), (0, 0, 0), (8, 0, 1.4)), "row"), Pose(depth=2)),
    ],
)
def test_what_no_scene_measured_is_unknown(indenter, pose):
    assert np.isinf(bounds_of(Scene(indenter, pose))).all()


@pytest.mark.parametrize("radius", [1.0, 2.9, 3.1, 8.0])
def test_another_radius_is_known_with_its_own_tables(radius, monkeypatch):
    tips = Tips(np.zeros((1, 1, 2)), np.ones((1, 1)), np.array([radius]))
    nominal = Tips(tips.xy, tips.depth, np.array([RADIUS_MM]))
    together = Tips(np.zeros((2, 1, 2)), np.ones((2, 1)), np.array([radius, RADIUS_MM]))
    assert of(together).tolist() == [*of(tips), *of(nominal)]
    assert np.isfinite(of(together)).all()
    assert np.isinf(of(Tips(np.zeros((1, 3, 2)), np.ones((1, 3)), tips.radius))).all()
    other = replace(shipped_file("tips.npz"), digest="0")
    monkeypatch.setattr("tactibench_sim.error_bounds.shipped_file", lambda _: other)
    assert np.isinf(of(tips)).all()
    assert np.isfinite(of(nominal)).all()


def test_another_table_or_tier_or_instance_is_unknown():
    scene = Scene(SINGLE, Pose(depth=2))
    assert np.isfinite(sensor().error_bounds([scene])).all()
    assert np.isfinite(sensor(TacTip331, pin_length=1.0).error_bounds([scene]))
    assert np.isinf(sensor(tier="superpose").error_bounds([scene])).all()
    assert np.isinf(bounds_of(scene, digest="0" * 64)).all()
    assert np.isinf(sensor(instance=3).error_bounds([scene])).all()
    assert sensor(Reference127).error_bounds([scene]) is None


def test_terms_are_counted():
    apart = Indenter(3.0, ((0, 0, 0), (8, 0, -9)), "one touches")
    scenes = [
        Scene(SINGLE, Pose(depth=1)),
        Scene(apart, Pose(0, 0, depth=1)),
        Scene(SINGLE, Pose(3, 0, depth=1)),
        Scene(DUAL, Pose(depth=1)),
        Scene(TRIPLE, Pose(depth=3)),
        Scene(SINGLE, Pose()),
    ]
    assert sensor().terms(scenes) == {
        "untouched": 1,
        "single": 3,
        "pair": 1,
        "three or more": 1,
        "rim": 3,
    }
    added = sensor(tier="superpose").terms(scenes)
    assert added["added up"] == 2
    assert "pair" not in added
