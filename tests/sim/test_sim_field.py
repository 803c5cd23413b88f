"""Fields of single contacts: symmetry, continuity, smoothness."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RectBivariateSpline
from scipy.spatial.transform import Rotation

from tactibench import UserError
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.dome import TableMechanics, meridians
from tactibench_sim.mechanics.kernels import at_depth, at_polar, depression
from tactibench_sim.mechanics.tables import shipped
from tactibench_sim.pins import layout

DOME = TableMechanics(shipped(), "coupled")
PINS = layout(331)


def loads(contacts, radius=3.0):
    array = np.array([contacts], dtype=float)
    return DOME.loads(Tips(array[..., :2], array[..., 2], np.array([radius])))


def pins(contacts, directions=PINS, radius=3.0):
    return DOME.pin_tips(loads(contacts, radius), directions, 2.0)[0]


contacts = st.lists(
    st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.01, 5)), min_size=1, max_size=3
).filter(lambda c: all(math.dist(a[:2], b[:2]) > 0.5 for i, a in enumerate(c) for b in c[:i]))


@given(contacts, st.floats(-math.pi, math.pi))
def test_turning_the_scene_turns_the_field(scene, angle):
    turn = Rotation.from_euler("z", angle).as_matrix()
    xy = np.array(scene)[:, :2] @ turn[:2, :2].T
    turned = [(x, y, d) for (x, y), (_, _, d) in zip(xy, scene, strict=True)]
    assert pins(turned, PINS @ turn.T) == pytest.approx(pins(scene) @ turn.T, abs=2e-12)


@given(contacts)
def test_mirroring_the_scene_mirrors_the_field(scene):
    flip = np.array([-1.0, 1.0, 1.0])
    mirrored = [(-x, y, d) for x, y, d in scene]
    assert pins(mirrored, PINS * flip) == pytest.approx(pins(scene) * flip, abs=1e-12)


@pytest.mark.parametrize("radius", [3.0, math.inf])
def test_no_contact_is_exactly_rest(radius):
    rest = (DOME.inner - 2.0) * PINS
    for depth in (0.0, -0.2, -np.inf):
        assert pins([(1.0, 2.0, depth)], radius=radius) == pytest.approx(rest, abs=1e-14)
        assert (pins([(1.0, 2.0, depth)], radius=radius) == pins([(0.0, 0.0, -np.inf)])).all()


@pytest.mark.parametrize("radius", [3.0, math.inf])
def test_the_first_touch_is_continuous(radius):
    rest = pins([(3.0, -2.0, 0.0)], radius=radius)
    for depth in (1e-2, 1e-4, 1e-8, 1e-12):
        moved = abs(pins([(3.0, -2.0, depth)], radius=radius) - rest).max()
        assert 0 <= moved < 4 * depth


def test_pins_at_the_contact_spread_by_lever_and_dip():
    rest, pressed = (DOME.inner - 2) * PINS, pins([(0.0, 0.0, 1.0)])
    ring = slice(1, 7)
    outward = np.linalg.norm(pressed[ring, :2], axis=1) - np.linalg.norm(rest[ring, :2], axis=1)
    assert (outward > 0.1).all()
    assert pressed[0, 2] - rest[0, 2] == pytest.approx(-0.96, abs=0.03)


def test_smooth_in_pose():
    """Second differences shrink with the square of the step: no kinks from the tables."""

    def bend(h):
        track = np.array([pins([(2.0 + k * h, 1.0, 2.0 + k * h)]) for k in range(-1, 2)])
        return abs(track[0] - 2 * track[1] + track[2]).max() / h**2

    coarse, fine = bend(1e-2), bend(1e-3)
    assert fine < 3 * coarse + 1


def test_look_up_is_the_tensor_spline():
    """scipy's bicubic spline on the same nodes, away from the ends where conditions differ."""
    one = shipped().by_radius[3.0]
    table = meridians(one.delta, one.polar, [[one.fields["w_outer"]]])
    spline = RectBivariateSpline(one.delta, one.polar, one.fields["w_outer"])
    polar = np.radians(np.linspace(5, 80, 40))
    row = np.empty(table.value.shape[2:])
    for depth in (1.23, 4.5, 6.01):
        at_depth(table, 0, depth, 1.0, row)
        one_by_one = [depression(table, 0, depth, angle) for angle in polar]
        by_row = [at_polar(row, table.polar_step, angle, 0) for angle in polar]
        assert one_by_one == pytest.approx(spline(depth, polar)[0], abs=1e-5)
        assert by_row == pytest.approx(one_by_one, abs=1e-12)


def test_beyond_the_rim_nothing_moves():
    n = np.array([[0.0, math.sin(2.0), math.cos(2.0)]])
    assert (DOME.skin(loads([(0.0, 0.0, 5.0)]), n) == 0).all()


def test_unknown_radius_and_tier():
    with pytest.raises(UserError, match=r"radius is 4 mm.*3 mm, plate"):
        loads([(0.0, 0.0, 1.0)], radius=4.0)
    with pytest.raises(UserError, match="tier is 'fast'"):
        TableMechanics(shipped(), "fast")
