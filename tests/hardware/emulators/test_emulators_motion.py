"""Profiles of motion against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from tactibench_tactip.emulators import Envelope
from tactibench_tactip.emulators.motion import (
    MM_PER_RADIAN,
    Leg,
    Line,
    Profile,
    braking,
    trapezoid,
)
from tactibench_tactip.emulators.poses import matrix

LENGTH = st.floats(1e-3, 500)
SPEED = st.floats(0.1, 300)
RATE = st.floats(1, 5000)


@settings(max_examples=40, deadline=None)
@given(LENGTH, SPEED, RATE)
def test_from_rest_to_rest_takes_the_textbook_time(length: float, v: float, a: float) -> None:
    profile = trapezoid(length, v, a)
    reaches = v * v / a <= length
    expected = length / v + v / a if reaches else 2 * math.sqrt(length / a)
    assert profile.seconds == pytest.approx(expected)
    assert profile.way == pytest.approx(length)
    assert profile.at(profile.seconds)[1] == pytest.approx(0.0, abs=1e-6 * v)


@settings(max_examples=40, deadline=None)
@given(LENGTH, SPEED, RATE, st.floats(0, 400), st.floats(0, 400))
def test_any_start_and_end_speed(
    length: float, v: float, a: float, first: float, last: float
) -> None:
    profile = trapezoid(length, v, a, first, last)
    assert profile.way == pytest.approx(length, rel=1e-9, abs=1e-9)
    start, end = profile.at(0.0), profile.at(profile.seconds)
    assert start[1] == pytest.approx(first)
    assert end[1] <= max(v, math.sqrt(first**2 + 2 * a * length)) + 1e-6
    times = np.linspace(0, profile.seconds, 50)
    ways, speeds = zip(*(profile.at(float(t)) for t in times), strict=True)
    assert all(np.diff(ways) >= -1e-9 * length)
    assert max(speeds) <= max(first, v) + 1e-6
    harder = first > min(last, v) and first**2 - min(last, v) ** 2 >= 2 * a * length
    most = max((abs(phase.acceleration) for phase in profile.phases), default=0.0)
    assert harder or most <= a * (1 + 1e-9)
    for before, after in zip(profile.phases, profile.phases[1:], strict=False):
        assert before.at(after.start) == pytest.approx((after.way, after.speed), abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(LENGTH, SPEED, RATE, st.floats(0, 1))
def test_when_is_the_inverse_of_the_way(length: float, v: float, a: float, share: float) -> None:
    profile = trapezoid(length, v, a)
    t = profile.when(share * length)
    assert profile.at(t)[0] == pytest.approx(share * length, abs=1e-7 * length)


@settings(max_examples=40, deadline=None)
@given(SPEED, RATE)
def test_braking_takes_v_squared_over_two_a(v: float, a: float) -> None:
    profile = braking(v, a)
    assert profile.way == pytest.approx(v * v / (2 * a))
    assert profile.seconds == pytest.approx(v / a)


def test_no_length_and_no_speed_are_no_motion() -> None:
    assert trapezoid(0.0, 10.0, 100.0) == Profile(())
    assert braking(0.0, 10.0) == Profile(())
    assert Profile(()).at(3.0) == (0.0, 0.0)
    assert Profile(()).when(1.0) == 0.0


def test_a_line_turns_about_one_axis_while_it_goes() -> None:
    start, end = matrix((0, 0, 0, 0, 0, 0)), matrix((10, 0, 0, 0, 0, 90))
    line = Line(start, end)
    assert line.length == pytest.approx(math.pi / 2 * MM_PER_RADIAN)
    half = line.at(line.length / 2)
    assert np.allclose(half, matrix((5, 0, 0, 0, 0, 45)))
    assert np.allclose(line.many(np.array([0.0, line.length])), [start, end])
    assert Line(start, start).length == 0.0


ANGLE = st.floats(-170, 170)


@settings(max_examples=40, deadline=None)
@given(st.tuples(ANGLE, ANGLE, ANGLE), st.tuples(ANGLE, ANGLE, ANGLE))
def test_a_turn_goes_the_shortest_way_at_an_even_rate(
    one: tuple[float, float, float], other: tuple[float, float, float]
) -> None:
    line = Line(matrix((0, 0, 0, *one)), matrix((10, 0, 0, *other)))
    shares = np.linspace(0.0, 1.0, 5)
    ends = Rotation.from_euler("xyz", [one, other], degrees=True)
    assume((ends[0].inv() * ends[1]).magnitude() < math.pi - 1e-3)
    between = Slerp([0.0, 1.0], ends)(shares).as_matrix()
    found = line.many(shares * line.length)
    assert np.allclose(found[:, :3, :3], between, atol=1e-7)
    assert np.allclose(found[:, 0, 3], 10.0 * shares)
    assert np.allclose([line.at(share * line.length) for share in shares], found)


def test_an_envelope_holds_all_poses_or_not() -> None:
    box = Envelope(x=(-1, 1), y=(-2, 2), z=(-3, 3), tilt=20.0)
    inside = [(1, 2, 3, 0, 0, 170), (-1, -2, -3, 19.9, 0, 0)]
    assert box.holds(np.array([matrix(pose) for pose in inside]))
    for bad in (
        (1.1, 0, 0, 0, 0, 0),
        (0, -2.1, 0, 0, 0, 0),
        (0, 0, 3.1, 0, 0, 0),
        (0, 0, 0, 0, 20.1, 0),
        (0, 0, 0, 180, 0, 0),
    ):
        assert not box.holds(np.array([matrix(pose) for pose in (*inside, bad)]))


def test_a_leg_stops_where_its_profile_ends() -> None:
    line = Line(matrix((0, 0, 0, 0, 0, 0)), matrix((0, 0, 100, 0, 0, 0)))
    leg = Leg(5.0, line, braking(20.0, 100.0))
    assert leg.end_s == pytest.approx(5.2)
    assert leg.at(99.0)[2, 3] == pytest.approx(2.0)
    assert leg.at(0.0)[2, 3] == 0.0
    assert leg.speed(5.1) == pytest.approx(10.0)
    assert leg.speed(5.3) == 0.0
    assert leg.when(2.0) == pytest.approx(5.2, abs=1e-6)
