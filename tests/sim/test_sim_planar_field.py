"""The pad's mechanics: properties that hold whatever the table's numbers are; then the table."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim import PadMechanics, Tips, shipped_file, square_grid

FILE = shipped_file("pad.npz")
PAD, THICKNESS = FILE.arrays, FILE.parameters["pad"]["thickness"]
COUPLED, SUPERPOSED = PadMechanics(FILE), PadMechanics(FILE, "superpose")
MARKERS = square_grid(14, 1.5)
DEEPEST = COUPLED.deepest


def tips(*rows):
    """One scene of (x, y, depth)."""
    a = np.array(rows, dtype=float)
    return Tips(a[None, :, :2], a[None, :, 2], np.array([3.0]))


def moved(*rows, mechanics=COUPLED, markers=MARKERS):
    return mechanics.markers(mechanics.loads(tips(*rows)), markers)[0]


def below(*rows, at=None, mechanics=COUPLED):
    """Depression of the surface at points (default: under the tips)."""
    points = np.array(rows)[:, :2] if at is None else np.asarray(at, dtype=float)
    return -mechanics.surface(mechanics.loads(tips(*rows)), points)[0, :, 2]


def lost_volume(r, w, t):
    """Volume missing under a surface displaced by w (inward) and t (outward), of the dent's own.

    integral of w over the deformed plane, d(pi (r + t)^2): what leaves through the end of r, apart
    from numerical errors, since the pad keeps its volume.
    """
    area = 2 * np.pi * (r + t) * (1 + CubicSpline(r, t)(r, 1))
    return simpson(w * area, x=r) / simpson(np.maximum(w, 0.0) * area, x=r)


place = st.floats(-6.4, 6.4)
tip = st.tuples(place, place, st.floats(-0.8, DEEPEST))


@given(st.lists(tip, min_size=1, max_size=4))
@settings(max_examples=100, deadline=None)
def test_every_tip_reaches_its_depth_or_stands_clear(several):
    """The complementarity in its own terms, from surfaces under single tips."""
    loads = COUPLED.loads(tips(*several))
    e = (loads.amplitude * loads.shape)[0]
    under = np.array(
        [np.interp(s, PAD["delta"], PAD["w_surface"][0, :, 0]) for s in loads.shape[0]]
    )
    assert (loads.shape <= DEEPEST).all()
    scale = np.divide(loads.shape[0], under, out=np.ones_like(under), where=under > 0)
    gap = -np.array([row[2] for row in several])
    for j in range(len(several)):
        if e[j] > 0:
            distance = np.hypot(*(np.array(several)[:, :2] - several[j][:2]).T)
            points = np.stack([distance, 0 * distance], axis=1)
            alone = below((0, 0, loads.shape[0, j]), at=points)
            gap += alone * loads.amplitude[0, j] * scale[j]
    assert (e >= 0).all()
    assert (gap > -2e-4).all()
    assert (abs(gap[e > 0]) < 2e-4).all()


@given(st.lists(tip, min_size=1, max_size=4), st.floats(-math.pi, math.pi))
@settings(max_examples=60, deadline=None)
def test_turning_and_mirroring_the_press_turns_and_mirrors_the_field(several, angle):
    c, s = math.cos(angle), math.sin(angle)
    for q in (np.array([[c, -s], [s, c]]), np.array([[1.0, 0.0], [0.0, -1.0]])):
        turned = [(*(q @ row[:2]), row[2]) for row in several]
        found = moved(*turned, markers=MARKERS @ q.T)
        expected = moved(*several)
        np.testing.assert_allclose(found[:, :2], expected[:, :2] @ q.T, atol=1e-9)
        np.testing.assert_allclose(found[:, 2], expected[:, 2], atol=1e-9)


@given(st.lists(tip, min_size=2, max_size=4), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_the_order_of_tips_does_not_matter(several, random):
    mixed = list(several)
    random.shuffle(mixed)
    np.testing.assert_allclose(moved(*mixed), moved(*several), atol=1e-9)


def test_no_contact_moves_nothing():
    for mechanics in (COUPLED, SUPERPOSED):
        assert (moved((0, 0, 0.0), (3, 0, -0.3), mechanics=mechanics) == 0).all()


@given(tip)
@settings(max_examples=60, deadline=None)
def test_two_identical_tips_are_one(one):
    np.testing.assert_allclose(moved(one, one), moved(one), atol=1e-8)
    third = (4.0, 3.0, 1.5)
    np.testing.assert_allclose(moved(one, one, third), moved(one, third), atol=1e-6)


def test_a_tip_in_a_dimple_carries_nothing():
    dimple = below((0, 0, 2.0), at=[[1.0, 0.0]])[0]
    loads = COUPLED.loads(tips((0, 0, 2.0), (1.0, 0.0, dimple - 0.1)))
    assert loads.amplitude[0].tolist() == [1.0, 0.0]


@pytest.mark.parametrize("distance", [6.5, 7.0, 8.0, 9.5, 12.0])
@pytest.mark.parametrize("depth", [0.5, 1.0, 3.0])
def test_both_tips_of_a_pair_reach_their_depth(distance, depth):
    pair = ((0, 0, depth), (distance, 0, 0.7 * depth))
    reached = below(*pair)
    assert reached == pytest.approx([depth, 0.7 * depth], rel=6e-3)
    alone = np.array([below(one)[0] for one in pair])
    wrong = abs(below(*pair, mechanics=SUPERPOSED) - alone)
    assert wrong.max() > 5 * abs(reached - alone).max()


def test_the_field_grows_continuously_from_nothing():
    sizes = [abs(moved((0.3, 0.2, d))).max() for d in (1e-9, 1e-6, 1e-3, 1e-2)]
    assert sizes[0] < 1e-8
    assert (np.diff(sizes) > 0).all()
    path = np.linspace(0.0, DEEPEST, 601)
    fields = np.stack([moved((0.3, 0.2, d), (5.0, 1.0, d - 1.0)) for d in path])
    assert abs(np.diff(fields, axis=0)).max() < 2.5 * (path[1] - path[0])


def test_at_its_nodes_the_spline_is_the_table():
    r = PAD["r"][:200:7]
    for i in (3, 12, 24):
        found = moved((0, 0, PAD["delta"][i]), markers=np.stack([r, 0 * r], axis=1))
        np.testing.assert_allclose(-found[:, 2], PAD["w"][0, i, :200:7], atol=1e-12)
        np.testing.assert_allclose(found[:, 0], PAD["t"][0, i, :200:7], atol=1e-12)


def test_the_shipped_pad_keeps_its_volume():
    f = PAD
    lost = [
        lost_volume(PAD["r"], f["w_surface"][0, i], f["t_surface"][0, i])
        for i in range(1, len(PAD["delta"]))
    ]
    assert np.abs(lost).max() < 0.01
    assert np.ptp(lost) < 1e-3  # what is lost leaves through the end of the table, at every depth


def test_the_shipped_force_rises_and_begins_as_a_bonded_layer():
    """Dimitriadis et al., Biophys. J. 82 (2002) 2798, eq. 12: sphere on a bonded layer, nu = 1/2.

    It is for small strain and a paraboloid, and 5 % off where chi = a / h = 0.25.
    """
    force, delta = PAD["force"][0], PAD["delta"]
    assert (np.diff(force) > 0).all()
    for i in (1, 2, 3, 4):
        chi = math.sqrt(3.0 * delta[i]) / THICKNESS
        layer = 1 + 1.133 * chi + 1.283 * chi**2 + 0.769 * chi**3 + 0.0975 * chi**4
        hertz = 16 / 9 * math.sqrt(3.0) * delta[i] ** 1.5
        assert force[i] == pytest.approx(hertz * layer, rel=0.05)


def test_far_away_the_bulge_decays_as_theory_says():
    """Slowest mode of a bonded incompressible layer: cos s = s, so that it decays as exp(-s r / h).

    Its amplitude falls as 1 / sqrt(r) besides.
    """
    s = 0.7390851332
    r, w = PAD["r"], -PAD["w_surface"][0, 8]
    window = (r > 15) & (r < 35)
    slope = np.polyfit(r[window], np.log(w[window] * np.sqrt(r[window])), 1)[0]
    assert slope == pytest.approx(-s / THICKNESS, rel=0.05)


def test_what_the_tables_do_not_hold_is_refused():
    with pytest.raises(UserError, match=r"3\.10 mm into the pad; .* end at 3 mm"):
        COUPLED.loads(tips((0, 0, 3.1)))
    one = tips((0, 0, 1.0))
    with pytest.raises(UserError, match=r"radius is 2\.5 mm"):
        COUPLED.loads(Tips(one.xy, one.depth, np.array([2.5])))
    with pytest.raises(UserError, match=r"radius is 0\.5 mm"):
        COUPLED.loads(Tips(one.xy, one.depth, np.array([0.5])))
    with pytest.raises(UserError, match="the tier is 'best'"):
        PadMechanics(FILE, "best")
