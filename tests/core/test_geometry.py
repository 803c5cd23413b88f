"""Contact geometry against an indenter that is lowered step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from penetration import normal_penetration

from tactibench import Contacts, Indenter, Pose, Scene, UserError
from tactibench.geometry import (
    DOME_RADIUS_MM,
    plate_contact_xy,
    plate_from_contacts,
    plate_pose,
    tip_depths,
    tip_positions,
    true_contacts,
)

place = st.floats(-6.4, 6.4)
angle = st.floats(-180, 180)
depth = st.floats(0.5, 6.0)
height = st.integers(0, 6).map(lambda k: 0.5 * k)
indenters = st.one_of(
    st.builds(Indenter.single, st.floats(0.5, 6)),
    st.builds(Indenter.dual, st.floats(6.5, 12)),
    st.builds(Indenter.triple, st.tuples(height, height, height)),
)
scenes = st.builds(
    Scene, indenters, st.builds(Pose, x=place, y=place, yaw=angle, tilt=st.just(0.0), depth=depth)
)


def lowered_tips(scene, travel):
    """Tip centres (K, 3), the apex at z = 0, when the holder has come down from z = 100 mm."""
    turn = math.radians(scene.pose.yaw)
    tips = []
    for dx, dy, dz in scene.indenter.offsets:
        x = scene.pose.x + dx * math.cos(turn) - dy * math.sin(turn)
        y = scene.pose.y + dx * math.sin(turn) + dy * math.cos(turn)
        tips.append((x, y, 100.0 - dz - travel))
    return np.array(tips)


def gaps(scene, travel):
    """(K,) distance from the tips' surfaces to the dome's, negative when they overlap."""
    centre = np.array([0.0, 0.0, -DOME_RADIUS_MM])
    away = np.linalg.norm(lowered_tips(scene, travel) - centre, axis=1)
    return away - DOME_RADIUS_MM - scene.indenter.radius


def first_touch(scene, tip):
    """Travel at which a tip first touches, by bisection; its centre stays above the dome's."""
    high, low = 0.0, 100.0 - scene.indenter.offsets[tip][2] + DOME_RADIUS_MM
    assume(gaps(scene, low)[tip] < 0)
    for _ in range(60):
        middle = (high + low) / 2
        high, low = (middle, low) if gaps(scene, middle)[tip] > 0 else (high, middle)
    return (high + low) / 2


@given(scenes)
@settings(max_examples=60, deadline=None)
def test_depths_are_travel_past_each_tips_first_touch(scene):
    touches = [first_touch(scene, k) for k in range(len(scene.indenter.offsets))]
    travel = min(touches) + scene.pose.depth
    expected = [travel - touch for touch in touches]
    np.testing.assert_allclose(tip_depths(scene), expected, atol=1e-6)
    assert max(expected) == pytest.approx(scene.pose.depth)
    overlap = -gaps(scene, travel)
    np.testing.assert_allclose(normal_penetration(scene), overlap, atol=1e-6)


@given(scenes)
def test_contacts_are_the_touching_tips_on_their_axes(scene):
    depths = tip_depths(scene)
    contacts = true_contacts(scene)
    np.testing.assert_array_equal(contacts.depth, depths[depths > 0])
    np.testing.assert_allclose(contacts.xy, lowered_tips(scene, 0.0)[depths > 0, :2], atol=1e-9)
    assert (contacts.score == 1).all()


@given(scenes, angle)
def test_turning_the_scene_turns_the_contacts(scene, turn):
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    rotation = np.array([[c, -s], [s, c]])
    pose = scene.pose
    x, y = rotation @ [pose.x, pose.y]
    turned = Scene(scene.indenter, Pose(x, y, pose.yaw + turn, 0.0, pose.depth))
    np.testing.assert_allclose(tip_depths(turned), tip_depths(scene), atol=1e-9)
    expected = tip_positions(scene)[:, :2] @ rotation.T
    np.testing.assert_allclose(tip_positions(turned)[:, :2], expected, atol=1e-9)


def test_positive_yaw_turns_x_towards_y():
    right = tip_positions(Scene(Indenter.dual(8.0), Pose(1.0, 2.0, yaw=90.0)))[1]
    assert right[:2] == pytest.approx([1.0, 6.0])


def test_a_tip_that_does_not_touch_is_no_contact():
    """12 mm apart, one on the apex: the other is 3.4 mm higher up, more than the depth."""
    scene = Scene(Indenter.dual(12.0), Pose(x=6.0, depth=1.0))
    assert tip_depths(scene) == pytest.approx([1.0, 1.0 - (23 - math.sqrt(23**2 - 144))])
    assert len(true_contacts(scene)) == 1
    assert len(true_contacts(Scene(Indenter.single(), Pose(depth=0.0)))) == 0


def test_a_tip_beside_the_dome_never_touches():
    scene = Scene(Indenter.dual(30.0), Pose(x=10.0, depth=5.0))
    assert tip_depths(scene)[1] == -math.inf
    assert len(true_contacts(scene)) == 1
    lost = Scene(Indenter.single(), Pose(x=23.0, depth=5.0))
    assert tip_depths(lost).tolist() == [-math.inf]
    assert len(true_contacts(lost)) == 0


@given(st.floats(-60, 60), depth)
def test_plate_round_trip(tilt, deep):
    scene = Scene(Indenter.plate(), Pose(tilt=tilt, depth=deep))
    contacts = true_contacts(scene)
    assert contacts.xy[0] == pytest.approx([20 * math.sin(math.radians(tilt)), 0.0])
    read = plate_from_contacts(contacts)
    assert read is not None
    assert read.tilt == pytest.approx(tilt, abs=1e-6)
    assert read.depth == deep
    assert plate_pose(scene).tilt == tilt
    assert plate_pose(scene).depth == deep


@given(st.floats(-60, 60), angle, depth)
def test_a_plate_touches_where_its_normal_leaves_the_dome(tilt, yaw, deep):
    """The touching point of a plate is the dome's point whose normal is the plate's."""
    x, y = true_contacts(Scene(Indenter.plate(), Pose(yaw=yaw, tilt=tilt, depth=deep))).xy[0]
    normal = np.array([x, y, math.sqrt(400 - x * x - y * y)]) / 20
    assert math.acos(min(1.0, normal[2])) == pytest.approx(abs(math.radians(tilt)), abs=1e-6)
    along = math.cos(math.radians(yaw)) * x + math.sin(math.radians(yaw)) * y
    assert along == pytest.approx(20 * math.sin(math.radians(tilt)), abs=1e-9)


def test_no_plate_without_a_contact():
    assert plate_from_contacts(Contacts.none()) is None
    assert len(true_contacts(Scene(Indenter.plate(), Pose(depth=0.0)))) == 0
    far = plate_from_contacts(Contacts.truth([[25.0, 0.0]], [1.0]))
    assert far is not None
    assert far.tilt == 90.0


flat_place = st.floats(-40, 40)
flat_depth = st.floats(0.5, 3.0)
flat_height = st.integers(0, 6).map(lambda k: 0.5 * k)
flat_indenters = st.one_of(
    st.builds(Indenter.single, st.floats(0.5, 6)),
    st.builds(Indenter.dual, st.floats(0.5, 12)),
    st.builds(Indenter.triple, st.tuples(flat_height, flat_height, flat_height)),
)
flat_scenes = st.builds(
    Scene,
    flat_indenters,
    st.builds(
        Pose,
        x=flat_place,
        y=flat_place,
        yaw=st.floats(-180, 180),
        tilt=st.just(0.0),
        depth=flat_depth,
    ),
)


@given(flat_scenes)
def test_every_tip_touches_at_its_own_height(scene):
    """The holder stands above the plane; tip k touches after its clearance, high - dz_k."""
    clearance = np.array([10.0 - dz for _, _, dz in scene.indenter.offsets])
    travel = clearance.min() + scene.pose.depth
    np.testing.assert_allclose(tip_depths(scene, math.inf), travel - clearance, atol=1e-12)


@given(flat_scenes)
def test_it_is_the_limit_of_large_domes(scene):
    np.testing.assert_allclose(tip_depths(scene, 1e9), tip_depths(scene, math.inf), atol=1e-5)


def test_a_plate_has_no_point_of_contact_on_a_flat_pad():
    scene = Scene(Indenter.plate(), Pose(depth=1.0))
    for ask in (true_contacts, plate_contact_xy):
        with pytest.raises(UserError, match="touches a flat pad everywhere"):
            ask(scene, math.inf)
    with pytest.raises(UserError, match="touches a flat pad everywhere"):
        plate_from_contacts(Contacts.truth([[1.0, 0.0]], [1.0]), math.inf)
