"""Poses and moves against closed forms, and against scipy, which was written by others."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from tactibench_tactip.emulators.motion import (
    MM_PER_RADIAN,
    Move,
    Profile,
    from_ur,
    inverse,
    line_length,
    matrix,
    pose6,
    to_ur,
)

LENGTH, SPEED, RATE = st.floats(1e-3, 500), st.floats(0.1, 300), st.floats(1, 5000)
PLACE, ANGLE = st.floats(-900, 900), st.floats(-180, 180)
POSE = st.tuples(PLACE, PLACE, PLACE, ANGLE, ANGLE, ANGLE)
HOME = matrix((0, 0, 0, 0, 0, 0))


@settings(max_examples=40, deadline=None)
@given(POSE)
def test_a_pose_is_a_matrix_of_extrinsic_angles_and_a_rotation_vector_of_a_ur(
    pose: tuple[float, ...],
) -> None:
    m = matrix(pose)  # type: ignore[arg-type]
    turns = [
        Rotation.from_euler(axis, a, degrees=True) for axis, a in zip("xyz", pose[3:], strict=True)
    ]
    assert np.allclose(m[:3, :3], (turns[2] * turns[1] * turns[0]).as_matrix())
    assert np.allclose(m[:3, 3], pose[:3])
    assert np.allclose(matrix(pose6(m)), m, atol=1e-9)
    assert np.allclose(inverse(m) @ m, np.eye(4), atol=1e-9)
    values = to_ur(m)
    assert np.allclose(values[:3] * 1000, pose[:3])
    assert np.linalg.norm(values[3:]) <= np.pi + 1e-9
    assert np.allclose(from_ur(values), m, atol=1e-5)


def test_where_angles_are_not_unique_the_pose_is_still_the_same_turn() -> None:
    m = matrix((1.0, 2.0, 3.0, 20.0, 90.0, 50.0))
    assert pose6(m)[4] == pytest.approx(90.0)
    assert np.allclose(matrix(pose6(m)), m, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(LENGTH, SPEED, RATE)
def test_from_rest_to_rest_takes_the_textbook_time(length: float, v: float, a: float) -> None:
    profile = Profile.from_rest(length, v, a)
    reaches = v * v / a <= length
    expected = length / v + v / a if reaches else 2 * math.sqrt(length / a)
    assert profile.seconds == pytest.approx(expected)
    assert profile.length == pytest.approx(length)
    times = np.linspace(0.0, profile.seconds, 400)
    ways = profile.way(times)
    assert (np.diff(ways) >= -1e-9 * length).all()
    middle = 0.5 * (times[1:] + times[:-1])
    speeds = np.array([profile.speed(float(t)) for t in middle])
    assert speeds.max() <= v * (1 + 1e-9)
    assert np.allclose(np.diff(ways) / np.diff(times), speeds, atol=2 * a * times[1])
    assert profile.speed(-1.0) == profile.speed(profile.seconds + 1.0) == 0.0


@settings(max_examples=40, deadline=None)
@given(SPEED, RATE, st.floats(0.05, 0.95))
def test_braking_takes_v_squared_over_two_a_and_stays_on_the_line(
    v: float, a: float, share: float
) -> None:
    move = Move.travel(5.0, HOME, matrix((0, 0, 900, 0, 0, 0)), v, a)
    t = 5.0 + share * move.profile.seconds
    speed, z = move.speed(t), float(move.pose(t)[2, 3])
    braked = move.braked(t, 1e-6)  # too soft for the line that is left
    assert float(braked.pose(braked.end_s)[2, 3]) == pytest.approx(900.0, rel=1e-6)
    braked = move.braked(t, 2 * a)
    assert braked.speed(t) == pytest.approx(speed)
    end = min(z + speed**2 / (4 * a), 900.0)
    assert float(braked.pose(braked.end_s + 9)[2, 3]) == pytest.approx(end, abs=1e-6)


def test_no_length_is_no_motion() -> None:
    move = Move.travel(1.0, HOME, HOME, 10.0, 100.0)
    assert move.end_s == 1.0
    assert np.array_equal(move.pose(2.0), HOME)
    assert np.array_equal(move.braked(1.0, 5.0).pose(3.0), HOME)


@settings(max_examples=40, deadline=None)
@given(st.tuples(ANGLE, ANGLE, ANGLE), st.tuples(ANGLE, ANGLE, ANGLE))
def test_a_turn_goes_the_shortest_way_at_an_even_rate(
    first: tuple[float, float, float], last: tuple[float, float, float]
) -> None:
    ends = Rotation.from_euler("xyz", [first, last], degrees=True)
    angle = (ends[0].inv() * ends[1]).magnitude()
    assume(1e-3 < angle < math.pi - 1e-3)
    move = Move.travel(0.0, matrix((0, 0, 0, *first)), matrix((10, 0, 0, *last)), 20.0, 500.0)
    assert move.length == pytest.approx(max(10.0, angle * MM_PER_RADIAN))
    times = np.linspace(0.0, move.end_s, 7)
    shares = move.profile.way(times) / move.length
    poses = move.poses(times)
    assert np.allclose(
        poses[:, :3, :3], Slerp([0.0, 1.0], ends)(np.clip(shares, 0, 1)).as_matrix(), atol=1e-6
    )
    assert np.allclose(poses[:, 0, 3], 10.0 * shares)
    assert np.array_equal(poses[-1][:3, 3], [10.0, 0.0, 0.0])
    assert line_length(HOME, HOME) == 0.0
