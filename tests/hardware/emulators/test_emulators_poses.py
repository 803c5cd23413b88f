"""Poses against scipy's rotations, which were written by others."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tactibench_tactip.emulators.poses import (
    from_ur,
    inverse,
    matrix,
    pose6,
    rotation,
    rotation_vector,
    to_ur,
)

LENGTH = st.floats(-900, 900)
ANGLE = st.floats(-180, 180)
POSE = st.tuples(LENGTH, LENGTH, LENGTH, ANGLE, ANGLE, ANGLE)
VECTOR = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3)


@settings(max_examples=40, deadline=None)
@given(POSE)
def test_a_matrix_is_that_of_extrinsic_angles(pose: tuple[float, ...]) -> None:
    m = matrix(pose)
    assert np.allclose(m[:3, :3], Rotation.from_euler("xyz", pose[3:], degrees=True).as_matrix())
    assert np.allclose(m[:3, 3], pose[:3])
    assert np.allclose(matrix(pose6(m)), m, atol=1e-9)
    assert np.allclose(inverse(m) @ m, np.eye(4), atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(POSE)
def test_what_a_ur_calls_a_pose_is_metres_and_a_rotation_vector(pose: tuple[float, ...]) -> None:
    m = matrix(pose)
    values = to_ur(m)
    assert np.allclose(values[:3] * 1000, pose[:3])
    assert np.allclose(Rotation.from_rotvec(values[3:]).as_matrix(), m[:3, :3], atol=1e-7)
    assert np.linalg.norm(values[3:]) <= np.pi + 1e-9
    assert np.allclose(from_ur(values), m, atol=1e-5)


@settings(max_examples=40, deadline=None)
@given(VECTOR, st.sampled_from([1e-9, 1e-4, 1.0, np.pi - 1e-4, np.pi - 1e-9, np.pi]))
def test_rotation_vectors_near_no_turn_and_half_a_turn(
    axis: tuple[float, ...], angle: float
) -> None:
    vector = np.array(axis) / np.linalg.norm(axis) * angle
    again = rotation_vector(rotation(vector))
    assert np.allclose(rotation(again), rotation(vector), atol=1e-7)


def test_where_angles_are_not_unique_the_pose_is_still_the_same_turn() -> None:
    m = matrix((1.0, 2.0, 3.0, 20.0, 90.0, 50.0))
    assert pose6(m)[4] == pytest.approx(90.0)
    assert np.allclose(matrix(pose6(m)), m, atol=1e-9)
