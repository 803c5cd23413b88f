"""The dome's mechanics by tables: look-ups, load sharing and its limits."""

from dataclasses import replace

import numpy as np
import pytest
from hard_scenes import tips
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RectBivariateSpline

from tactibench import UserError
from tactibench_sim import (
    Corrections,
    TableMechanics,
    at_depth,
    at_polar,
    depression,
    layout,
    meridians,
    shipped_dome,
)

COUPLED, SUPERPOSE = (TableMechanics(shipped_dome(), tier) for tier in ("coupled", "superpose"))
BARE = TableMechanics(replace(shipped_dome(), corrections=Corrections({}, {})), "coupled")
PINS = layout(127)


def pins(*contacts, directions=PINS):
    return COUPLED.pin_tips(COUPLED.loads(tips(*contacts)), directions, 2.0)[0]


def test_pins_at_the_contact_spread_by_lever_and_dip():
    rest, pressed = (COUPLED.inner - 2) * PINS, pins((0.0, 0.0, 1.0))
    ring = slice(1, 7)
    outward = np.linalg.norm(pressed[ring, :2], axis=1) - np.linalg.norm(rest[ring, :2], axis=1)
    assert (outward > 0.1).all()
    assert pressed[0, 2] - rest[0, 2] == pytest.approx(-0.96, abs=0.03)


def test_look_up_is_the_tensor_spline():
    """scipy's bicubic spline on the same nodes, away from the ends where conditions differ."""
    one = shipped_dome().by_radius[3.0]
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


def test_unknown_radius_and_tier():
    with pytest.raises(UserError, match=r"radius is 4 mm.*3 mm, plate"):
        COUPLED.loads(tips((0.0, 0.0, 1.0), radius=4.0))
    with pytest.raises(UserError, match="tier is 'fast'"):
        TableMechanics(shipped_dome(), "fast")


contact = st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.01, 5))


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
