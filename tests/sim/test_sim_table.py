"""Tables: reference figures, what mechanics demands, other radii, corrections, load sharing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hard_scenes import enclosed_volume, tips
from hypothesis import given, settings
from hypothesis import strategies as st
from other_scenes import OTHER_TIPS
from scipy.interpolate import BSpline, RectBivariateSpline

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench_sim import (
    Corrections,
    TableMechanics,
    TacTip127,
    Tips,
    at_depth,
    at_polar,
    deepest_of,
    layout,
    look_up,
    meridians,
    pair_amounts,
    quantity_at,
    shipped_dome,
    tip_tables,
)

TABLES = shipped_dome()
SPHERE, PLATE = TABLES.by_radius[3.0], TABLES.by_radius[math.inf]
BOTH = pytest.mark.parametrize("one", [SPHERE, PLATE], ids=["sphere", "plate"])


def test_forces_of_an_independent_feasibility_run():
    """Same dome, another code and mesh; its figures carry two or three digits."""
    depths = np.array([0.25, 0.5, 1.0, 1.5, 2.0])
    force = np.interp(depths, SPHERE.delta, SPHERE.fields["force"])
    assert force == pytest.approx([0.043, 0.088, 0.173, 0.259, 0.353], rel=0.012)


@BOTH
def test_fields_begin_at_rest_end_at_the_rim_and_follow_the_indenter(one):
    assert one.fields["force"][0] == 0
    assert (np.diff(one.fields["force"]) > 0).all()
    for name in ("w", "t", "omega", "w_outer", "t_outer"):
        assert abs(one.fields[name][0]).max() < 1e-9
        assert name == "omega" or abs(one.fields[name][:, -1]).max() < 1e-5
    assert one.fields["w_outer"][:, 0] == pytest.approx(one.delta, abs=0.004)


@BOTH
@pytest.mark.parametrize(("which", "radius"), [("", 19.0), ("_outer", 20.0)])
def test_enclosed_volume_is_conserved(one, which, radius):
    """What the dimple takes the bulge gives, to 1 % of the dimple: nu is 1/2 exactly."""
    start = enclosed_volume(radius, one.polar, 0 * one.polar, 0 * one.polar)
    for row in (4, 8, 24, 48, 52):
        w, t = one.fields[f"w{which}"][row], one.fields[f"t{which}"][row]
        dimple = start - enclosed_volume(radius, one.polar, np.maximum(w, 0), 0 * w)
        assert abs(enclosed_volume(radius, one.polar, w, t) - start) < 0.01 * dimple


PINS = layout(127)
EXACT_MM = 0.06
COUPLED = TableMechanics(TABLES, "coupled")
OTHERS = TableMechanics(TABLES, "coupled", other_tips=True)
BARE = TableMechanics(replace(TABLES, corrections=Corrections({}, {})), "coupled")


def bases(scene, mechanics=OTHERS):
    return mechanics.displacement(mechanics.loads(scene), PINS)[0]


def force(radius, depth):
    return float(OTHERS.forces(OTHERS.loads(tips((0, 0, depth), radius=radius)))[0, 0])


def test_scenes_by_finite_elements_are_met() -> None:
    worst: dict[float, float] = {}
    for scene in OTHER_TIPS:
        moved = OTHERS.displacement(OTHERS.loads(scene.as_tips), scene.directions)[0][0]
        error = float(np.linalg.norm(moved - scene.displacement, axis=1).max())
        worst[scene.radius] = max(worst.get(scene.radius, 0.0), error)
    assert set(worst) >= {1.0, 1.75, 6.0, 7.0}
    assert max(worst.values()) < EXACT_MM, worst


@pytest.mark.parametrize("radius", [1.0, 1.5, 2.9, 5.0, 7.3])
def test_a_tip_reaches_its_depth_and_its_force_grows(radius) -> None:
    depths = np.linspace(0.1, deepest_of(radius), 7)
    table = tip_tables(radius).by_radius[radius]
    assert table.fields["w_outer"][:, 0] == pytest.approx(table.delta, abs=0.02)
    forces = [force(radius, depth) for depth in depths]
    assert (np.diff(forces) > 0).all()
    assert (np.array([force(1.08 * radius, depth) for depth in depths]) > forces).all()


def test_radii_beside_the_nominal_one_press_alike() -> None:
    for places in (((2, 1, 2.0),), ((-3.5, 0, 2.0), (3.5, 0, 3.0))):
        for radius in (2.99, 3.01):
            difference = bases(tips(*places, radius=radius)) - bases(tips(*places))
            assert abs(difference).max() < 0.02


def test_a_batch_of_many_radii_is_its_scenes_one_by_one() -> None:
    rng = np.random.default_rng(1)
    radius = np.array([3.0, 1.0, 6.5, 3.0, 1.0, 2.3, np.inf])
    xy = np.where(np.isinf(radius)[:, None, None], 0.0, rng.uniform(-5, 5, (7, 2, 2)))
    depth = np.column_stack([rng.uniform(0.3, 1.4, 7), np.full(7, -np.inf)])
    depth[:4, 1] = 0.8
    together = bases(Tips(xy, depth, radius))
    for k in range(7):
        alone = Tips(xy[k : k + 1], depth[k : k + 1], radius[k : k + 1])
        assert np.array_equal(together[k], bases(alone)[0])
        if radius[k] in COUPLED.nominal.radii:
            assert np.array_equal(together[k], bases(alone, COUPLED)[0])


@pytest.mark.parametrize(
    ("radius", "depth", "message"),
    [
        (0.9, 0.5, "1 to 8 mm"),
        (8.5, 0.5, "1 to 8 mm"),
        (1.0, 1.8, "tables end at 1.5 mm"),
        (2.0, 3.2, "tables end at 3 mm"),
        (6.0, 4.2, "tables end at 4 mm"),
    ],
)
def test_beyond_the_tables_is_refused(radius, depth, message) -> None:
    sensor = TacTip127(SensorContext(np.random.SeedSequence(1)), friction=0.0)
    with pytest.raises(UserError, match=message):
        sensor.press(Scene(Indenter.single(radius), Pose(depth=depth)))
    assert sensor.press(Scene(Indenter.single(3.0), Pose(depth=depth))).image.any()


def test_look_up_is_the_tensor_spline():
    """scipy's bicubic spline on the same nodes, away from the ends where conditions differ."""
    table = meridians(SPHERE.delta, SPHERE.polar, [[SPHERE.fields["w_outer"]]])
    spline = RectBivariateSpline(SPHERE.delta, SPHERE.polar, SPHERE.fields["w_outer"])
    polar = np.radians(np.linspace(5, 80, 40))
    row = np.empty(table.value.shape[2:])
    for depth in (1.23, 4.5, 6.01):
        at_depth(table, 0, depth, 1.0, row)
        one_by_one = [quantity_at(table, 0, depth, angle, 0) for angle in polar]
        by_row = [at_polar(row, table.polar_step, angle, 0) for angle in polar]
        assert one_by_one == pytest.approx(spline(depth, polar)[0], abs=1e-5)
        assert by_row == pytest.approx(one_by_one, abs=1e-12)


def test_unknown_radius_and_tier():
    with pytest.raises(UserError, match=r"radius is 4 mm.*3 mm, plate"):
        COUPLED.loads(tips((0.0, 0.0, 1.0), radius=4.0))
    with pytest.raises(UserError, match="tier is 'fast'"):
        TableMechanics(TABLES, "fast")


contact = st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.01, 5))


@settings(max_examples=30)
@given(st.lists(contact, min_size=2, max_size=6))
def test_every_tip_reaches_its_depth_or_stands_clear(contacts):
    """Without the corrections, which also move the skin sideways under a tip."""
    scene = tips(*contacts)
    loads = BARE.loads(scene)
    n, delta = scene.directions()
    skin = BARE.skin(loads, n[0])[0]
    assert (loads[0].amplitude >= 0).all()
    assert (skin >= delta[0] - 0.004).all()  # the table's own contact stiffness
    carrying = loads[0].amplitude[0] > 1e-6
    assert skin[carrying] == pytest.approx(delta[0][carrying], abs=0.004)


STEP, START, ALONG, ACROSS = math.radians(5), -10 * math.radians(5), 21, 11
GRID = np.random.default_rng(3).normal(size=(ALONG + 2, ACROSS + 2, 6))


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.01, math.radians(40)),
    st.floats(0.01, 3.1) | st.floats(-3.1, -0.01),
    st.integers(0, 100),
)
def test_a_patch_is_the_tensor_spline_of_lamberts_chart(r, azimuth, seed):
    """In any frame. What lies at b < 0 is the mirror image: components along f change sign."""
    frame = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    at = np.array([math.sin(r) * math.cos(azimuth), math.sin(r) * math.sin(azimuth), math.cos(r)])
    chord = 2 * math.sin(r / 2)
    a, b = chord * math.cos(azimuth), chord * math.sin(azimuth)
    knots = [START + STEP * np.arange(-3, ALONG + 3), STEP * np.arange(-3, ACROSS + 3)]
    over_a = BSpline(knots[0], GRID, 3)(a)
    told = BSpline(knots[1], over_a, 3)(abs(b)) * np.where(b < 0, [1, -1, 1, 1, -1, 1], 1)
    found = np.array(look_up(GRID, STEP, START, frame, *(at @ frame)))
    assert found == pytest.approx(told, abs=1e-9)


@pytest.mark.parametrize("where", ["base", "skin"])
def test_pair_modes_are_exactly_even_or_odd(where):
    """Exchanging the contacts mirrors a: the even modes stay, the odd ones turn over."""
    modes = TABLES.corrections.pairs(where, (3.0,)).modes.grid
    even = TABLES.corrections.grid["pair_even"]
    other = modes[:, ::-1] * np.array([-1.0, 1.0, 1.0] * 2)
    assert (modes[:even] == other[:even]).all()
    assert (modes[even:] == -other[even:]).all()


@given(st.floats(0.05, 1.0), st.floats(0.1, 6.4), st.floats(0.1, 6.4))
def test_pair_amounts_have_the_parity_of_their_modes(angle, first, second):
    pairs = TABLES.corrections.pairs("base", (3.0,))
    even = TABLES.corrections.grid["pair_even"]
    one, other = np.empty(pairs.amounts.shape[-1]), np.empty(pairs.amounts.shape[-1])
    pair_amounts(pairs, angle, first, second, one)
    pair_amounts(pairs, angle, second, first, other)
    assert one[:even] == pytest.approx(other[:even], abs=1e-12)
    assert one[even:] == pytest.approx(-other[even:], abs=1e-12)


def test_nothing_is_corrected_where_nothing_was_learned():
    none = Corrections({}, {})
    assert (none.around("base", (3.0,)).amounts == 0).all()
    assert none.pairs("base", (3.0,)).indenter == -1
    known = TABLES.corrections.around("base", (2.0, 3.0))
    assert (known.amounts[0] == 0).all()
    assert (known.amounts[1] != 0).any()
