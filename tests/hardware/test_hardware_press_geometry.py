"""A press on the dome as a pose of the tool, and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench import Indenter, Pose, Scene
from tactibench_tactip import (
    FrameSettings,
    Pose6,
    PressGeometry,
    angle_between,
    from_ur,
    inverse,
    matrix,
    pose_of,
    to_ur,
    touch_height,
)

WORK: Pose6 = (109.1, -487.0, 341.3, 180.0, 0.0, -90.0)
angle = st.floats(-179.0, 179.0)
length = st.floats(-7.0, 7.0)
poses = st.tuples(length, length, length, angle, st.floats(-80.0, 80.0), angle)
indenters = st.one_of(
    st.just(Indenter.single()),
    st.floats(6.5, 12.0).map(Indenter.dual),
    st.tuples(*[st.sampled_from([0.0, 0.5, 3.0])] * 3).map(Indenter.triple),
)
scenes = st.builds(
    Scene, indenters, st.builds(Pose, length, length, angle, st.just(0.0), st.floats(-10.0, 6.0))
)
frames = st.builds(
    FrameSettings,
    moves=st.sampled_from(["indenter", "sensor"]),
    work_frame=st.just(WORK),
    sensor=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), angle),
)
domes = st.sampled_from([20.0, 25.0, math.inf])


def almost(one: Pose, other: Pose) -> None:
    for name in ("x", "y", "yaw", "tilt", "depth"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-7), name


@given(poses)
def test_poses_and_matrices_are_each_others_inverse(pose: Pose6) -> None:
    assert pose_of(matrix(pose)) == pytest.approx(pose, abs=1e-7)
    assert np.allclose(inverse(matrix(pose)) @ matrix(pose), np.eye(4))
    assert from_ur(to_ur(pose)) == pytest.approx(pose, abs=1e-6)


def test_angles_are_extrinsic() -> None:
    """The rotation about x is made first, then about the fixed y, then about the fixed z."""
    a, b, c = (math.radians(v) for v in (20.0, -30.0, 50.0))
    x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    assert np.allclose(matrix((0, 0, 0, 20.0, -30.0, 50.0))[:3, :3], z @ y @ x)


@given(scenes, frames, domes, st.floats(-3.0, 3.0))
def test_a_press_comes_back_from_its_pose(
    scene: Scene, keys: FrameSettings, dome: float, z0: float
) -> None:
    geometry = PressGeometry(keys, dome, z0)
    almost(geometry.reached(scene, geometry.tool_pose(scene)).pose, scene.pose)


@given(frames, st.floats(-20.0, 20.0), angle, st.floats(-5.0, 4.0))
def test_a_plate_comes_back_from_its_pose(
    keys: FrameSettings, tilt: float, yaw: float, depth: float
) -> None:
    scene = Scene(Indenter.plate(), Pose(0.0, 0.0, yaw, tilt, depth))
    geometry = PressGeometry(keys, 20.0, 0.3)
    almost(geometry.reached(scene, geometry.tool_pose(scene)).pose, scene.pose)


@given(scenes, frames)
def test_deeper_is_straight_along_the_work_frames_z(scene: Scene, keys: FrameSettings) -> None:
    geometry = PressGeometry(keys, 20.0)
    high, low = (np.array(geometry.at_depth(scene, depth)) for depth in (-2.0, 3.0))
    if keys.moves == "indenter":
        assert low[:3] - high[:3] == pytest.approx([0.0, 0.0, 5.0], abs=1e-9)
    assert np.linalg.norm(low[:3] - high[:3]) == pytest.approx(5.0)
    assert angle_between(tuple(high), tuple(low)) == pytest.approx(0.0, abs=1e-5)


@given(scenes)
def test_tips_of_the_tool_lie_on_the_dome_at_first_touch(scene: Scene) -> None:
    """Independent of the closed form: the gap between spheres, tip by tip."""
    keys = FrameSettings(work_frame=WORK, sensor=(0.4, -0.3, 25.0))
    geometry = PressGeometry(keys, 20.0, 0.7)
    tool = matrix(geometry.at_depth(scene, 0.0))
    radius = scene.indenter.radius
    tips = np.array([[x, -y, z - radius, 1.0] for x, y, z in scene.indenter.offsets]) @ tool.T
    centre = matrix((0.4, -0.3, 0.7, 180.0, 0.0, 0.0)) @ [0.0, 0.0, -20.0, 1.0]
    gaps = np.linalg.norm(tips[:, :3] - centre[:3], axis=1) - (20.0 + radius)
    assert gaps.min() == pytest.approx(0.0, abs=1e-9)


def test_contacts_are_where_the_tool_is() -> None:
    """x of the image along the work frame's x, y against its y; depth is past first touch."""
    geometry = PressGeometry(FrameSettings(work_frame=WORK), 20.0)
    scene = Scene(Indenter.single(), Pose(3.0, -2.0, depth=1.5))
    x, y, z, *turn = geometry.tool_pose(scene)
    sag = math.sqrt(23.0**2 - 13.0) - 23.0
    assert (x, y, z) == pytest.approx((3.0, 2.0, 1.5 - sag))
    assert turn == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_yaw_keeps_the_plans_count_of_turns() -> None:
    geometry = PressGeometry(FrameSettings(work_frame=WORK))
    scene = Scene(Indenter.dual(8.0), Pose(0.0, 0.0, 359.5, 0.0, 1.0))
    assert geometry.reached(scene, geometry.tool_pose(scene)).pose.yaw == pytest.approx(359.5)


def test_a_tip_beside_the_dome_never_touches() -> None:
    assert touch_height(Scene(Indenter.single(), Pose(30.0, 0.0)), 20.0) == -math.inf
