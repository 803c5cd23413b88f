"""Error bounds: those that ship are what tables and reference scenes give, and they hold."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from error_bounds import Fit, by_contacts, measure, measured
from other_scenes import INSTANCES, OTHER_TIPS, SPACINGS

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench.protocols import draw_scenes, protocol_files, read_protocol
from tactibench_sim import (
    BEYOND,
    FRICTION_TERMS,
    LEVER_MM,
    MISSED_MM,
    RADIUS_MM,
    FrictionMechanics,
    Reference127,
    TableMechanics,
    TacTip127,
    TacTip331,
    Tips,
    envelope_terms,
    missed_depths,
    reference_scenes,
    reference_tips,
    shipped_bounds,
    shipped_dome,
    tips_of,
)

pytestmark = pytest.mark.long

SCENES = reference_scenes()
EVERY = (*SCENES, *SPACINGS, *OTHER_TIPS)
BOUNDS = shipped_bounds()
SINGLE, DUAL = Indenter.single(), Indenter.dual(8.0)
TRIPLE = Indenter.triple((0, 1, 0.5))
MECHANICS = TableMechanics(shipped_dome(), "coupled", other_tips=True)


def sensor(kind=TacTip127, **parameters):
    return kind(SensorContext(np.random.SeedSequence(0)), **parameters)


def bounds_of(*scenes, length=0.5, friction=None, **more):
    tips = tips_of(scenes)
    if friction is not None:
        tips = replace(tips, friction=np.full(len(tips), friction))
    return BOUNDS.bound(tips, length, **more)


def test_the_bounds_that_ship_are_those_of_the_tables_and_the_scenes():
    new = measured(EVERY, INSTANCES)
    assert BOUNDS.instance == pytest.approx(new.instance, abs=2e-6)
    for old, made in zip(BOUNDS.envelopes, new.envelopes, strict=True):
        for name in ("base", "tip"):
            stored, found = getattr(old, name), getattr(made, name)
            assert stored == pytest.approx(found, abs=2e-6)
            assert (stored >= found - 1e-9).all()  # rounded up
        for name in ("deepest", "nearest", "farthest", "lowest", "most"):
            assert getattr(old, name) == pytest.approx(getattr(made, name), abs=1e-4)


@pytest.mark.parametrize("kind", [TacTip127, TacTip331])
def test_no_pin_of_a_reference_scene_is_off_by_more_than_the_bound(kind):
    """For pins of the preset's length, for shorter and for longer ones."""
    for factor_ in (0.0, 1.0, 4.0):
        preset = sensor(kind)
        one = sensor(kind, pin_length=factor_ * preset.pin_length)
        for scene in SCENES:
            model = FrictionMechanics(MECHANICS, scene.friction) if scene.friction else MECHANICS
            loads = model.loads(scene.as_tips)
            seen = model.pin_tips(loads, one.directions, one.pin_length)[0]
            error = np.linalg.norm(seen - reference_tips(one, scene), axis=1).max()
            assert error <= BOUNDS.bound(scene.as_tips, one.pin_length)[0], scene.label


def test_no_base_of_any_scene_is_off_by_more_than_the_bound():
    found = measure(EVERY)
    assert (found.errors[:, 0] <= BOUNDS.bound(found.tips, 0.0)).all()
    known = np.isfinite(found.errors[:, 1])
    assert (found.errors[known, 1] <= BOUNDS.bound(found.tips, LEVER_MM)[known]).all()


def test_beyond_the_measured_range_the_factor_holds():
    """The deepest and the nearest scenes and the triples, each left out in turn."""
    every = measure([scene for scene in SCENES if not scene.friction])
    for fewest, scenes in by_contacts(every):
        n, delta = scenes.tips.directions()
        outer = {"deep": delta.max(axis=1) > 4.6}
        if fewest > 1:
            outer["many"] = (delta > 0).sum(axis=1) > 2
            outer["near"] = (n[:, 0] * n[:, 1]).sum(axis=1) > np.cos(np.radians(20))
        terms = envelope_terms(scenes.tips)[:, : FRICTION_TERMS.start]
        for name, left in outer.items():
            for errors in scenes.errors.T:
                fit = Fit(terms, errors, errors)
                ratio = fit.excess(left) / fit.factor(scenes.families)
                assert ratio < BEYOND, (fewest, name)


def test_envelope_terms_are_those_of_the_formula():
    rng = np.random.default_rng(1)
    xy, depth = rng.uniform(-6, 6, (20, 3, 2)), rng.uniform(-1, 5, (20, 3))
    tips = Tips(xy, depth, np.full(20, 3.0), friction=rng.uniform(0, 1, 20))
    for terms, n, delta, mu in zip(
        envelope_terms(tips), *tips.directions(), tips.friction, strict=True
    ):
        d = delta.clip(0)
        first, second = sorted(d)[:0:-1]
        steep = max(d**3 * (1 - n[:, 2] ** 2) ** 2)
        rim = 0.0
        for i, j in combinations(range(3), 2):
            middle = np.arccos((n[i] + n[j])[2] / np.linalg.norm(n[i] + n[j]))
            rim += np.sin(middle) ** 2 * d[i] * d[j]
        way = max(d * np.tan(np.arccos(n[:, 2])))
        rubbing = [np.sqrt(mu * way), mu * way]
        expected = [np.sqrt(first), first, steep, second, second**2, rim, *rubbing]
        assert terms == pytest.approx(expected, abs=1e-12)


def test_a_bound_grows_with_depth_contacts_length_and_friction():
    rng = np.random.default_rng(2)
    xy, depth = rng.uniform(-6, 6, (40, 3, 2)), rng.uniform(0.2, 2.5, (40, 3))
    deep = BOUNDS.bound(Tips(xy, depth, np.full(40, 3.0)), 0.5)
    assert (BOUNDS.bound(Tips(xy, depth, np.full(40, 3.0)), 1.5) >= deep).all()
    two, one = depth.copy(), depth.copy()
    two[:, 2], one[:, 1:] = -np.inf, -np.inf
    several = [BOUNDS.bound(Tips(xy, d, np.full(40, 3.0)), 0.5) for d in (one, two)]
    assert (several[0] <= several[1]).all()
    for step in (1, 2):  # the range ends with depth, so that the factor only begins to count
        alone = Tips(xy[:, :1], depth[:, :1] + step, np.full(40, 3.0))
        assert (BOUNDS.bound(alone, 0.5) >= several[0]).all()
    rough = [
        BOUNDS.bound(Tips(xy, two, np.full(40, 3.0), friction=np.full(40, mu)), 0.5)
        for mu in (0.0, 0.3, 0.6)
    ]
    assert (rough[0] == several[1]).all()
    assert (rough[1] >= rough[0]).all()
    assert (rough[2] >= rough[1]).all()


def test_tips_that_do_not_touch_change_no_bound():
    far = Indenter(3.0, ((0, 0, 0), (8, 0, -9)), "custom")
    turned = Scene(DUAL, Pose(2, 1, 200, 0, 3))
    assert bounds_of(Scene(far, Pose(depth=3))) == bounds_of(Scene(SINGLE, Pose(depth=3)))
    assert bounds_of(turned) == pytest.approx(bounds_of(Scene(DUAL, Pose(2, 1, 20, 0, 3))))
    assert bounds_of(Scene(DUAL, Pose()))[0] == 0.0  # the rest frame


@pytest.mark.parametrize("name", ["exp1", "exp2", "exp3", "fine"])
@pytest.mark.parametrize("instance", [0, 3])
def test_every_scene_of_the_experiments_has_a_bound(name, instance):
    """Held-out families, such as three to five tips and uneven pairs, included."""
    spec = read_protocol(protocol_files()[name]).spec
    one = sensor(instance=instance)
    for draw in spec.draws:
        scenes = draw_scenes(spec, draw.name).scenes[:300]
        if instance and any(scene.indenter.radius != RADIUS_MM for scene in scenes):
            continue  # instances have no other tips
        assert np.isfinite(one.error_bounds(scenes)).all(), draw.name


@pytest.mark.parametrize("radius", [1.0, 2.9, 3.1, 8.0])
def test_other_radii_have_bounds_of_their_own(radius):
    tips = Tips(np.zeros((1, 1, 2)), np.ones((1, 1)), np.array([radius]))
    nominal = Tips(tips.xy, tips.depth, np.array([RADIUS_MM]))
    together = Tips(np.zeros((2, 1, 2)), np.ones((2, 1)), np.array([radius, RADIUS_MM]))
    bounds = [BOUNDS.bound(some, 0.5) for some in (tips, nominal, together)]
    assert bounds[2].tolist() == [*bounds[0], *bounds[1]]
    assert np.isfinite(bounds[2]).all()


def test_what_nobody_measured_is_unknown():
    scene = Scene(SINGLE, Pose(depth=2))
    assert np.isfinite(sensor().error_bounds([scene])).all()
    assert np.isinf(sensor(tier="superpose").error_bounds([scene])).all()
    assert np.isinf(bounds_of(Scene(Indenter.plate(), Pose(depth=1)))).all()
    assert sensor(Reference127).error_bounds([scene]) is None


def test_another_instance_has_a_larger_bound():
    scene = Scene(DUAL, Pose(1, 0, depth=3))
    assert bounds_of(scene, instance=True) > bounds_of(scene)


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


def test_a_field_that_misses_a_depth_is_counted():
    """Three deep tips beside the apex: the field is off by .43 mm there."""
    (worst,) = (scene for scene in SCENES if scene.label == "t8_1_1_5 at 6 mm")
    assert missed_depths(MECHANICS, worst.as_tips)[0] > MISSED_MM
    shallow = [scene for scene in SCENES if scene.depth <= 2 and not scene.friction]
    assert all(missed_depths(MECHANICS, scene.as_tips)[0] < MISSED_MM for scene in shallow)
    plain = TableMechanics(shipped_dome(), "superpose")
    assert missed_depths(plain, tips_of([Scene(DUAL, Pose(depth=3))]))[0] > MISSED_MM
    alone = tips_of([Scene(SINGLE, Pose(2, 1, depth=d)) for d in np.linspace(0, 6, 70)])
    assert missed_depths(MECHANICS, alone).max() < 0.02
