"""The hard cases that every tier must get right, one test a line."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hard_scenes import (
    NONE,
    PINS,
    carried,
    coupled_tier,
    dome,
    every_radius,
    every_tier,
    moved,
    pins,
    slanted,
    tips,
    towards,
    worst_jump,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tactibench import UserError
from tactibench_sim import STEEPEST_DEG, Corrections, TableMechanics, shipped_dome

# -- zero contact is bit-identical to rest


@every_tier
@every_radius
@pytest.mark.parametrize("depth", [0.0, -0.0, -0.5, -math.inf])
def test_zero_contact_displaces_nothing(tier, radius, depth):
    assert (moved(tier, (1.0, 2.0, depth), radius=radius) == 0).all()
    assert (moved(tier, (1.0, 2.0, depth), (-3.0, 1.0, depth), radius=radius) == 0).all()
    rest = pins(tier, NONE, radius=radius)
    assert (pins(tier, (1.0, 2.0, depth), radius=radius) == rest).all()
    assert rest == pytest.approx((dome(tier).inner - 2.0) * PINS, abs=1e-14)


# -- continuity as delta -> 0+


@every_tier
@every_radius
@pytest.mark.parametrize("degrees", [0.0, 20.0, 50.0])
def test_a_light_touch_moves_little(tier, radius, degrees):
    for delta in (1e-1, 1e-2, 1e-4, 1e-8, 1e-12):
        u = moved(tier, slanted(degrees, delta, radius), radius=radius)
        assert abs(u).max() < 1.5 * delta + 1e-9  # the table is in single precision


@every_tier
def test_a_light_touch_beside_a_deep_one_moves_little(tier):
    """In the dimple, beside it, on the bulge, far away."""
    for x in (1.0, 4.0, 8.0, 14.0):
        alone = moved(tier, (-3.0, 0.0, 4.0), (x, 0.5, 0.0))
        for depth in (1e-2, 1e-4, 1e-8):
            both = moved(tier, (-3.0, 0.0, 4.0), (x, 0.5, depth))
            assert abs(both - alone).max() < 10 * depth + 1e-12


# -- two identical indenters equal one


@coupled_tier
@pytest.mark.parametrize("depth", [0.5, 2.0, 6.0])
def test_identical_indenters_are_one(tier, depth):
    one = moved(tier, (2.0, 1.0, depth))
    for count in (2, 3, 5):
        several = moved(tier, *[(2.0, 1.0, depth)] * count)
        assert abs(several - one).max() < 1e-8


# -- spacing 0..2R at fixed depth


@every_tier
@pytest.mark.parametrize("depths", [(1.0, 1.0), (4.0, 4.0), (4.0, 1.0)])
def test_spacing_leads_from_one_to_two_without_a_jump(tier, depths):
    """From 0 past 2 R = 6 mm to where the tips no longer know of each other."""

    def field(gap):
        return moved(tier, (-gap / 2, 0.3, depths[0]), (gap / 2, 0.3, depths[1]))

    assert worst_jump(field, 0.0, 6.0, 60) < 1e-6
    assert worst_jump(field, 6.0, 22.0, 40) < 1e-6


# -- a tip inside another's bulge (delta > 0 yet not touching)


@coupled_tier
@pytest.mark.parametrize(
    ("x", "depth"), [(0.5, 1.0), (1.5, 0.3), (2.5, 0.1), (-1.0, 2.0), (3.0, 0.05)]
)
def test_a_tip_in_anothers_dimple_carries_nothing(tier, x, depth):
    """Its penetration of the undeformed dome is positive, but the skin is not there."""
    deep, shaded = (0.0, 0.0, 4.0), (x, 0.0, depth)
    assert (tips(deep, shaded).directions()[1] > 0).all()
    difference = moved(tier, deep, shaded) - moved(tier, deep)
    assert abs(difference).max() < 1e-12
    assert carried(tier, deep, shaded)[1] == 0


@coupled_tier
def test_a_bulge_lifts_the_skin_to_a_tip(tier):
    """The other way round: a tip that just hangs over the undeformed dome, met by the bulge."""
    deep, hanging = (-7.0, 0.0, 6.0), (8.5, 0.0, -0.02)
    assert carried(tier, deep, hanging)[1] > 0
    assert carried(tier, deep, (8.5, 0.0, -0.9))[1] == 0


# -- depth to 6 mm


@every_tier
@every_radius
@pytest.mark.parametrize("degrees", [0.0, 15.0, 30.0, 50.0])
def test_the_skin_follows_the_indenter_to_6_mm(tier, radius, degrees):
    mechanics = dome(tier)
    at = PINS if degrees else PINS[:1]
    for delta in (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0):
        scene = tips(slanted(degrees, delta, radius), radius=radius)
        loads = mechanics.loads(scene)
        under = mechanics.skin(loads, scene.directions()[0][0])[0, 0]
        assert under == pytest.approx(delta, abs=0.03)
        u, turn = mechanics.displacement(loads, at)
        assert np.isfinite(u).all()
        assert np.isfinite(turn).all()
        assert abs(u).max() < 1.3 * delta


# -- contact at the rim


@every_tier
@every_radius
def test_the_rim_is_refused(tier, radius):
    assert np.isfinite(moved(tier, slanted(STEEPEST_DEG - 0.1, 2.0, radius), radius=radius)).all()
    with pytest.raises(UserError, match=f"beyond {STEEPEST_DEG:g} deg"):
        moved(tier, slanted(STEEPEST_DEG + 0.1, 2.0, radius), radius=radius)


# -- rotation and mirror equivariance to 1e-12

SCENES = {
    "single": ((4.0, -2.0, 3.0),),
    "apex": ((0.0, 0.0, 5.0),),
    "dual": ((-3.0, 1.0, 4.0), (3.5, 2.0, 3.0)),
    "dimple": ((0.0, 1.0, 4.0), (1.5, 1.0, 0.3)),
    "triple": ((-4.0, 0.0, 1.0), (4.0, 0.5, 2.0), (0.3, 6.0, 4.5)),
}
contacts = st.lists(
    st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.05, 4)), min_size=1, max_size=3
).filter(lambda c: all(math.dist(a[:2], b[:2]) > 2 for i, a in enumerate(c) for b in c[:i]))


def random_and_named_scenes(test):
    """Try SCENES and some drawn ones."""
    test = settings(max_examples=8, deadline=None)(
        given(contacts, st.floats(-math.pi, math.pi))(test)
    )
    for scene in SCENES.values():
        test = example(scene, 2.5)(test)
    return test


@every_tier
@random_and_named_scenes
def test_turning_and_mirroring_the_scene_turns_and_mirrors_the_field(tier, scene, angle):
    u = moved(tier, *scene)
    turn = Rotation.from_euler("z", angle).as_matrix()
    for matrix in (turn, np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0])):
        image = [(*(matrix[:2, :2] @ contact[:2]), contact[2]) for contact in scene]
        assert abs(moved(tier, *image, at=PINS @ matrix.T) - u @ matrix.T).max() < 2e-12


@every_tier
@settings(max_examples=8, deadline=None)
@given(contacts)
def test_the_order_of_tips_does_not_matter(tier, scene):
    assert moved(tier, *scene[::-1]) == pytest.approx(moved(tier, *scene), abs=1e-9)


@pytest.mark.parametrize("tier", ["superpose", "coupled"])
@every_radius
def test_the_tables_know_no_direction(tier, radius):
    """Without the corrections for the rim the field turns with the scene in three dimensions."""
    apex = TableMechanics(replace(shipped_dome(), corrections=Corrections({}, {})), tier)
    n = np.array([[0.0, 0.1, 1.0], [0.3, 0.2, 1.0], [-0.2, 0.3, 1.0]])[: 1 if radius > 3 else 3]
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    delta = np.array([3.0, 2.0, 4.0])[: len(n)]
    fields = []
    for turn in (Rotation.identity(), Rotation.from_euler("zyx", [0.4, 0.3, -0.2])):
        loads = apex.loads(tips(*towards(turn.apply(n), delta, radius), radius=radius))
        u = apex.displacement(loads, turn.apply(PINS))[0][0]
        fields.append(turn.inv().apply(u))
    assert abs(fields[1] - fields[0]).max() < 1e-12
