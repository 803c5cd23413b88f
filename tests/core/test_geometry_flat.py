"""Contact geometry on a flat pad, and as the limit of ever larger domes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from penetration import normal_penetration

from tactibench import Contacts, Indenter, Pose, Scene, UserError
from tactibench.geometry import (
    plate_contact_xy,
    plate_from_contacts,
    tip_depths,
    tip_positions,
    true_contacts,
)

place = st.floats(-40, 40)
depth = st.floats(0.5, 3.0)
height = st.integers(0, 6).map(lambda k: 0.5 * k)
indenters = st.one_of(
    st.builds(Indenter.single, st.floats(0.5, 6)),
    st.builds(Indenter.dual, st.floats(0.5, 12)),
    st.builds(Indenter.triple, st.tuples(height, height, height)),
)
scenes = st.builds(
    Scene,
    indenters,
    st.builds(Pose, x=place, y=place, yaw=st.floats(-180, 180), tilt=st.just(0.0), depth=depth),
)


@given(scenes)
def test_every_tip_touches_at_its_own_height(scene):
    """The holder stands above the plane; tip k touches after its clearance, high - dz_k."""
    clearance = np.array([10.0 - dz for _, _, dz in scene.indenter.offsets])
    travel = clearance.min() + scene.pose.depth
    np.testing.assert_allclose(tip_depths(scene, math.inf), travel - clearance, atol=1e-12)


@given(scenes)
def test_contacts_lie_on_the_axes_of_the_tips_and_are_as_deep_as_they_went(scene):
    depths = tip_depths(scene, math.inf)
    found = true_contacts(scene, math.inf)
    np.testing.assert_array_equal(found.depth, depths[depths > 0])
    np.testing.assert_array_equal(found.xy, tip_positions(scene)[depths > 0, :2])
    np.testing.assert_array_equal(normal_penetration(scene, math.inf), depths)


@given(scenes)
def test_it_is_the_limit_of_large_domes(scene):
    np.testing.assert_allclose(tip_depths(scene, 1e9), tip_depths(scene, math.inf), atol=1e-5)


def test_where_the_tip_is_makes_no_difference():
    scenes = [Scene(Indenter.dual(9.0), Pose(x, 3.0, 20.0, 0.0, 1.5)) for x in (0.0, 6.0, 500.0)]
    for scene in scenes:
        assert tip_depths(scene, math.inf).tolist() == [1.5, 1.5]


def test_a_plate_has_no_point_of_contact_on_a_flat_pad():
    scene = Scene(Indenter.plate(), Pose(depth=1.0))
    for ask in (true_contacts, plate_contact_xy):
        with pytest.raises(UserError, match="touches a flat pad everywhere"):
            ask(scene, math.inf)
    with pytest.raises(UserError, match="touches a flat pad everywhere"):
        plate_from_contacts(Contacts.truth([[1.0, 0.0]], [1.0]), math.inf)
