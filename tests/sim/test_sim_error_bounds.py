"""Error bounds of the tiers: those that ship are what tables and reference scenes give."""

import json
import time
from dataclasses import fields, replace
from itertools import combinations

import error_bounds as maker
import numpy as np
import pytest
from error_bounds import largest, leave_out, measure, measured, reached, write

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench.protocols import draw_scenes, load_protocol
from tactibench_sim.error_bounds import (
    RADIUS_MM,
    Bounds,
    Envelope,
    angle_between,
    envelope_terms,
    scene_bounds,
    shipped,
    term_counts,
)
from tactibench_sim.mechanics import tables, tip_tables
from tactibench_sim.mechanics.contact import Tips, tips_of
from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.mechanics.tips import TipMechanics
from tactibench_sim.reference_frames import scenes as reference
from tactibench_sim.reference_frames.sensor import Reference127
from tactibench_sim.sensor import TacTip127, TacTip331

pytestmark = pytest.mark.long

TABLES, SCENES = tables.shipped(), reference.shipped()
OTHERS = reference.shipped_other_tips().scenes
COUPLED, SUPERPOSED = (TableMechanics(TABLES, tier) for tier in ("coupled", "superpose"))
SINGLE, DUAL, TRIPLE = Indenter.single(), Indenter.dual(8.0), Indenter.triple((0, 1, 0.5))


def sensor(kind=TacTip127, **parameters):
    return kind(SensorContext(np.random.SeedSequence(0)), **parameters)


def of(tips, tier="coupled", digest=TABLES.digest):
    return scene_bounds(tier, digest, tips)


def bounds_of(*scenes, **more):
    return of(tips_of(scenes), **more)


@pytest.fixture(scope="module")
def bounds():
    return measured(TABLES, (*SCENES, *OTHERS))


@pytest.fixture(scope="module")
def errors():
    return measure(TABLES, SCENES)


def test_the_bounds_that_ship_are_measured_and_of_the_tables_that_ship(bounds):
    digest, tips, stored = shipped()
    assert (digest, tips) == (TABLES.digest, tip_tables.shipped().digest)
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
    for scene in SCENES:
        for mechanics in (COUPLED, SUPERPOSED):
            u, _ = mechanics.displacement(mechanics.loads(scene.as_tips), scene.directions)
            error = np.linalg.norm(u[0] - scene.displacement, axis=1).max()
            assert error <= of(scene.as_tips, mechanics.tier)[0], scene.name


@pytest.mark.parametrize("count", [2, 3])
def test_a_family_of_runs_is_within_the_bound_that_the_others_give(errors, count):
    """The program of ``leave_out`` again, in full: what is left out is bounded by the others."""
    some = [one for one in errors if len(one.delta) == count]
    factor = (shipped()[2].pair if count == 2 else shipped()[2].many).factor
    assert max(leave_out(some).values()) <= factor
    for name in {one.name for one in some}:
        others = maker.envelope([one for one in some if one.name != name])
        for one in some:
            if one.name == name:
                free = Envelope(others.coefficients, factor, 9.0, 0.0, 3.0, 3.0)  # of any range
                assert one.error <= free.bound(one.n[None], one.delta[None])[0]


@pytest.mark.parametrize("kind", ["single", "pair"])
@pytest.mark.parametrize("sharper", [True, False])
def test_tips_of_other_radii_are_bounded_by_those_that_stay(kind, sharper):
    """Every family, and every radius of which enough others stay, is left out in turn."""
    bounds = shipped()[2].others[0 if sharper else 1]
    envelope = getattr(bounds, kind)
    errors = measure(TABLES, OTHERS)
    some = maker.other_tips(errors, bounds.smallest, bounds.largest)[kind == "pair"]
    ratios = leave_out(some)
    assert len({one.radius for one in some}) >= 3
    assert max(ratios.values()) <= envelope.factor


def test_no_scene_of_another_radius_is_worse_than_its_bound():
    mechanics = TipMechanics(COUPLED)
    for scene in OTHERS:
        u, _ = mechanics.displacement(mechanics.loads(scene.as_tips), scene.directions)
        error = np.linalg.norm(u[0] - scene.displacement, axis=1).max()
        assert error <= of(scene.as_tips)[0] < 0.2, scene.name
        alone = of(scene.as_tips, "superpose")[0]
        assert alone == of(scene.as_tips)[0] if len(scene.tips) == 1 else np.isinf(alone)


def test_a_spacing_of_pairs_is_left_out_as_well(errors):
    ratios = leave_out([one for one in errors if len(one.delta) == 2])
    spacings = ("6.5", "7", "8", "9.5", "12")
    assert {f"all {spacing} mm apart" for spacing in spacings} < set(ratios)
    for spacing in spacings:
        families = [v for k, v in ratios.items() if k.startswith(f"p{spacing}_")]
        assert ratios[f"all {spacing} mm apart"] >= max(families) - 0.1  # it knows less


def test_the_aims_for_exp2_and_exp3_are_reached():
    for protocol, draw, median, most in (
        ("exp1", "singles", 0.021, 0.03),
        ("exp2", "pairs", 0.080, 0.23),
        ("exp3", "triples", 0.120, 0.34),
    ):
        found = bounds_of(*draw_scenes(load_protocol(protocol).spec, draw).scenes)
        assert np.median(found) <= median
        assert found.max() <= most  # and none is unknown


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


def test_bounds_grow_with_depth_and_are_no_less_than_alone():
    depth = np.linspace(0.5, 5.9, 12)
    for indenter in (SINGLE, DUAL, TRIPLE):
        found = bounds_of(*(Scene(indenter, Pose(2, 1, 20, 0, d)) for d in depth))
        assert (np.diff(found) >= 0).all()
        assert (found >= bounds_of(*(Scene(SINGLE, Pose(depth=d)) for d in depth)) - 1e-4).all()


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
        (Indenter.dual(0.5), Pose(depth=1)),
        (Indenter.dual(16.0), Pose(depth=1)),
        (DUAL, Pose(depth=6.3)),
        (DUAL, Pose(17.0, 0, 90, depth=3)),  # 51 deg off, both tips touch
        (Indenter.triple((0, 0, 0), 12.0), Pose(depth=2)),
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
    other = replace(tip_tables.shipped(), digest="0")
    monkeypatch.setattr(tip_tables, "shipped", lambda: other)
    assert np.isinf(of(tips)).all()
    assert np.isfinite(of(nominal)).all()


def test_another_table_or_tier_or_instance_is_unknown():
    scene = Scene(SINGLE, Pose(depth=2))
    assert np.isfinite(sensor().error_bounds([scene])).all()
    assert np.isfinite(sensor(TacTip331, tier="superpose", pin_length=1.0).error_bounds([scene]))
    assert np.isinf(bounds_of(scene, digest="0" * 64)).all()
    assert np.isinf(sensor(instance=3).error_bounds([scene])).all()
    assert np.isinf(bounds_of(scene, tier="fem")).all()
    assert sensor(Reference127).error_bounds([scene]) is None


def test_bounds_of_many_scenes_do_not_depend_on_each_other():
    scenes = [
        Scene(Indenter.plate(), Pose(depth=1)),
        Scene(SINGLE, Pose(1, 2, depth=3)),
        Scene(DUAL, Pose(1, 2, 10, 0, 3)),
        Scene(TRIPLE, Pose(1, 2, 10, 0, 3)),
        Scene(SINGLE, Pose()),
    ]
    for tier in ("coupled", "superpose"):
        one_by_one = np.concatenate([bounds_of(scene, tier=tier) for scene in scenes])
        assert bounds_of(*scenes, tier=tier) == pytest.approx(one_by_one)


def test_bounds_of_a_test_set_take_no_time():
    spec = load_protocol("exp2").spec
    scenes = [scene for name in spec.test.sets for scene in draw_scenes(spec, name).scenes]
    assert len(scenes) == 1320
    one = sensor()
    one.error_bounds(scenes[:2])
    times = []
    for _ in range(5):
        begun = time.process_time()
        one.error_bounds(scenes)
        times.append(time.process_time() - begun)
    assert min(times) < 0.05


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
    assert term_counts("fem", tips_of(scenes)) == {"untouched": 1, "finite elements": 5}


def test_superposing_bounds_hold_the_difference_of_the_tiers(bounds):
    """Where both tiers are compared again, between the angles and depths of the table."""
    for scene in SCENES:
        if len(scene.tips) != 2:
            continue
        loads = COUPLED.loads(scene.as_tips)
        fields = [
            tier.displacement(tier.loads(scene.as_tips), scene.directions)[0]
            for tier in (COUPLED, SUPERPOSED)
        ]
        apart = np.linalg.norm(fields[0] - fields[1], axis=-1).max()
        angle = angle_between(loads.n[:1, 0], loads.n[:1, 1])
        first, second = loads.delta[0]
        assert apart <= bounds.superposing(angle, np.array([first]), np.array([second]))[0]


def test_the_table_is_symmetric_and_grows_with_depth(bounds):
    assert bounds.added == pytest.approx(bounds.added.swapaxes(1, 2), abs=1e-6)
    diagonal = np.diagonal(bounds.added, axis1=1, axis2=2)
    assert (np.diff(diagonal, axis=1) > 0).all()
    assert (bounds.added[:, 0] == 0).all()


def test_from_too_few_scenes_nothing_is_known():
    """One pair is all there is: nothing is known of single contacts, of pairs, or of three."""
    pair = next(s for s in SCENES if len(s.tips) == 2 and abs(s.depth - 2) < 1e-6)
    few = measured(TABLES, [pair])
    assert np.isinf(few.single).all()
    n, delta = pair.as_tips.directions()
    assert np.isinf(few.coupled(n, delta)).all()
    assert np.isinf(few.superposed(n, delta)).all()


def test_writing_rounds_up_and_keeps_infinity(tmp_path):
    values = np.array([0.0, 0.2, 0.123401, 0.1234, np.inf])
    row = values[None]
    envelope = Envelope(np.array([0.1234561, 0.5]), 1.1, 6.0, 0.25, 0.7, 0.8)
    bounds = Bounds(values, values, row, envelope, envelope, values, values, row[None])
    assert len(write(tmp_path / "b.json", TABLES, bounds)) == 64
    content = json.loads((tmp_path / "b.json").read_text())
    assert content["depth"] == [0.0, 0.2, 0.1235, 0.1234, None]
    assert content["added"] == [[content["depth"]]]
    assert content["pair"]["coefficients"] == [0.123457, 0.5]


def test_the_largest_error_never_falls():
    deepest, errors = np.array([0.5, 1.5, 2.5]), np.array([0.1, 0.3, 0.2])
    assert largest([1.0, 2.0, 3.0], deepest, errors).tolist() == [0.1, 0.3, 0.3]
    assert largest([1.0], np.zeros(0), np.zeros(0)).tolist() == [0.0]


def test_a_node_is_known_where_scenes_come_near_it():
    nodes = [1.0, 2.0, 4.0]
    assert reached(nodes, np.array([0.4])).tolist() == [False, False, False]
    assert reached(nodes, np.array([0.5, 1.5])).tolist() == [True, True, False]
    assert reached(nodes, np.array([3.0])).tolist() == [True, True, True]
    assert not reached(nodes, np.zeros(0)).any()
