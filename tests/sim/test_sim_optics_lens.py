"""Refraction and projection against ray shooting and closed forms."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from tactibench import UserError
from tactibench_sim import Optics, project, slope_per_mm

AIR = {"gel_index": 1.0, "window_index": 1.0}
PATHS = st.tuples(
    st.floats(0.0, 40.0),
    st.floats(1.0, 60.0),
    st.floats(0.0, 10.0),
    st.floats(0.01, 40.0),
    st.floats(1.0, 2.0),
    st.floats(1.0, 2.0),
)


def shot(angle, air, window, gel, window_index, gel_index):
    """Where a ray that leaves the camera at this angle is after the three layers (Snell's law)."""
    inside = math.asin(math.sin(angle) / window_index), math.asin(math.sin(angle) / gel_index)
    return air * math.tan(angle) + window * math.tan(inside[0]) + gel * math.tan(inside[1])


@given(PATHS)
def test_ray_shooting_finds_the_same_angle(path):
    rho, layers = path[0], path[1:]
    high = math.atan2(rho, layers[0]) + 1e-9  # without refraction it would be less steep inside
    angle = brentq(lambda a: shot(a, *layers) - rho, 0.0, high, xtol=1e-15, rtol=1e-14)
    assert slope_per_mm(rho, *layers) * rho == pytest.approx(math.tan(angle), rel=1e-11, abs=1e-14)


@pytest.mark.parametrize("rho", [1e-9, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("air", [1e-6, 1.0, 1e3])
def test_newton_converges_for_every_point(rho, air):
    s = slope_per_mm(rho, air, 2.0, 17.0, 1.49, 1.41) * rho
    reached = air * s + sum(
        d * s / math.sqrt(n * n + (n * n - 1) * s * s) for d, n in ((2.0, 1.49), (17.0, 1.41))
    )
    assert reached == pytest.approx(rho, rel=1e-12)


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(35.1, 60), st.floats(0.2, 3))
def test_without_refraction_it_is_a_pinhole(x, y, z, focal):
    optics = Optics(focal=focal, **AIR)
    u, v, radius = project(optics, np.array([x, y, z]))
    scale = focal * 128 / z
    assert (u, v) == (
        pytest.approx(63.5 + scale * x, abs=1e-10),
        pytest.approx(63.5 + scale * y, abs=1e-10),
    )
    assert radius == pytest.approx(scale * optics.marker_radius_mm, rel=1e-12)


def test_a_fisheye_is_equidistant():
    optics = Optics(lens="fisheye", size=101, focal=0.5, **AIR)
    angles = np.radians([0.0, 10.0, 40.0, 70.0])
    points = 60.0 * np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)
    near = dataclasses.replace(optics, camera_distance_mm=25.0)
    x, y, _ = project(near, points)
    assert x == pytest.approx(50 + 0.5 * 101 * angles, abs=1e-10)
    assert y == pytest.approx(np.full(4, 50.0))


def test_magnification_by_refraction_reaches_the_index_and_changes_with_depth():
    def against_air(optics, z):
        """Size of a small thing on the axis, relative to the same camera in air."""
        point = np.array([1e-6, 0.0, z])
        middle = (optics.size - 1) / 2
        seen, plain = (
            project(o, point)[0] - middle for o in (optics, dataclasses.replace(optics, **AIR))
        )
        return seen / plain

    touching = Optics(camera_distance_mm=22.001, window_mm=0.001, gel_mm=22.0 - 0.0001)
    assert against_air(touching, 20.0) == pytest.approx(1.41, rel=1e-3)
    usual = Optics()
    apex, rim = against_air(usual, 52.0), against_air(usual, 40.0)
    assert apex == pytest.approx(52 / (33 + 2 / 1.49 + 17 / 1.41), rel=1e-6)
    assert 1.0 < rim < apex < 1.41


@given(st.floats(0.01, 16.0), st.floats(-math.pi, math.pi), st.sampled_from(["pinhole", "fisheye"]))
def test_a_discs_radius_is_the_transverse_magnification(rho, azimuth, lens):
    optics, h = Optics(lens=lens), 1e-5
    turned = azimuth + np.array([-h, h])
    points = np.stack([rho * np.cos(turned), rho * np.sin(turned), [45.0, 45.0]], axis=1)
    x, y, radius = project(optics, points)
    apart = math.hypot(x[1] - x[0], y[1] - y[0]) / (2 * h * rho)
    assert radius[0] / optics.marker_radius_mm == pytest.approx(apart, rel=1e-5)


def test_x_is_right_y_is_down_and_the_axis_can_be_elsewhere():
    points = np.array([[0, 0, 17.0], [1, 0, 17], [0, 1, 17]])
    x, y, _ = project(Optics(size=101), points, 35.0)
    assert (x[0], y[0]) == (50, 50)
    assert (x[1] > 50, y[1]) == (True, 50)
    assert (x[2], y[2] > 50) == (50, True)
    moved = project(Optics(size=101, principal_x=0.1, principal_y=-0.05, roll_deg=90.0), points, 35)
    assert moved[0] == pytest.approx(60.1 - (y - 50), abs=1e-10)  # 90 deg take x to y
    assert moved[1] == pytest.approx(44.95 + (x - 50), abs=1e-10)


def test_a_marker_outside_the_gel_is_refused():
    for z in (34.9, 0.0, -5.0, math.nan):
        with pytest.raises(UserError, match=r"not in the gel, which begins 35 mm"):
            project(Optics(), np.array([[0.0, 0.0, 50.0], [0.0, 0.0, z]]))
