"""First touch: where a signal begins, and what the search does about it."""

from __future__ import annotations

import numpy as np
import pytest
from fake_station import TRUE_Z0, FakeCapture, FakeRobot, make_settings
from hypothesis import given
from hypothesis import settings as settings_of
from hypothesis import strategies as st

from tactibench_tactip import (
    Camera,
    GuardError,
    RobotError,
    Settings,
    Station,
    find_touch,
    fit_centre,
    fit_onset,
    fit_yaw,
    projections,
)

FOUND_MM = 0.03
"""Of 60 searches in other noise none was off by more than 0.015 mm, and their mean by 0.001 mm."""


@given(st.floats(-0.2, 0.2), st.sampled_from([1.0, 1.2, 1.5, 2.0]), st.integers(0, 50))
def test_the_begin_of_a_power_law_is_found(start: float, power: float, seed: int) -> None:
    depths = np.arange(-0.4, 0.65, 0.1)
    signal = 0.7 * np.maximum(0.0, depths - start) ** power
    noisy = signal + np.random.default_rng(seed).normal(0.0, 1e-4, len(depths))
    found = fit_onset(depths, noisy)
    assert found == pytest.approx(start, abs=0.02)


@pytest.mark.parametrize("level", [1.0, 2.0])
@pytest.mark.parametrize("power", [1.0, 1.5])
def test_noise_does_not_move_the_begin(level: float, power: float) -> None:
    """Noise of the rest frame is in every change, and that of the deepest frame in its own."""
    rng, depths = np.random.default_rng(0), np.arange(-0.3, 0.65, 0.1)
    pattern = 8.0 * (rng.uniform(0.0, 1.0, (48, 48)) < 0.1)
    found = []
    for _ in range(40):
        rest = rng.normal(0.0, 0.25 * level, pattern.shape)
        noise = rng.normal(0.0, 0.6 * level, (len(depths), *pattern.shape))
        images = pattern * np.maximum(0.0, depths)[:, None, None] ** power + noise
        found.append(fit_onset(depths[:-1], projections(images, rest)[:-1]))
    assert abs(np.mean(found)) < 0.02


def test_a_projection_is_blind_to_brightness() -> None:
    rng = np.random.default_rng(0)
    rest, change = rng.uniform(0, 200, (2, 16, 16))
    images = np.stack([rest + share * change for share in (0.0, 0.25, 1.0)])
    assert projections(images, rest) == pytest.approx([0.0, 0.25, 1.0])
    brighter = images + np.array([7.0, -3.0, 0.0])[:, None, None]
    assert projections(brighter, rest) == pytest.approx([0.0, 0.25, 1.0])


@pytest.fixture
def station(settings: Settings, robot: FakeRobot, camera: Camera) -> Station:
    return Station(settings, robot, camera)


def test_first_touch_is_found_and_taken_over(station: Station) -> None:
    with station.camera, station:
        touch = find_touch(station)
        assert touch.z0_mm == pytest.approx(TRUE_Z0, abs=FOUND_MM)
        assert station.geometry.z0 == touch.z0_mm
        rest = station.rest
        again = find_touch(station)
        assert station.rest is not rest  # the light may have changed
        assert again.z0_mm == pytest.approx(TRUE_Z0, abs=FOUND_MM)


def test_nothing_there_is_said(station: Station, capture: FakeCapture, robot: FakeRobot) -> None:
    capture.robot = None
    with station.camera, station:
        with pytest.raises(RobotError, match=r"3\.0 mm before.*contact.travel_mm"):
            find_touch(station)
        assert robot.tool()[2] <= -station.settings.envelope.clearance_mm + 0.1


def test_a_force_that_grows_with_the_steps_ends_a_search(
    robot: FakeRobot, camera: Camera, capture: FakeCapture
) -> None:
    """Two newtons a step, which alone are allowed, and nothing in the image."""
    capture.robot, robot.stiffness = None, 20.0
    station = Station(make_settings(envelope={"max_force_n": 5.0}), robot, camera)
    deepest: list[float] = []
    robot.fails = lambda _: deepest.append(robot.depth())
    with camera, station:
        with pytest.raises(GuardError, match="max_force_n"):
            find_touch(station)
        assert max(deepest) < 0.4
        assert robot.tool()[2] <= -station.settings.envelope.clearance_mm + 0.1


def test_a_fixed_place_is_not_searched(robot: FakeRobot, camera: Camera) -> None:
    settings = make_settings(contact={"method": "fixed", "fixed_mm": 0.3})
    with camera, Station(settings, robot, camera) as station:
        for _ in range(2):
            assert find_touch(station).z0_mm == 0.3
            assert len(robot.moves) == 4  # of the press that tries the camera, once


@settings_of(max_examples=25)
@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_the_centre_of_a_dome_from_heights(x: float, y: float, z: float) -> None:
    turn = np.linspace(0, 2 * np.pi, 7)[:-1]
    places = np.vstack([[0, 0], 4 * np.column_stack([np.cos(turn), np.sin(turn)])])
    heights = z + 23 - np.sqrt(23**2 - ((places - [x, y]) ** 2).sum(axis=1))
    centre, z0, std, rms = fit_centre(places, heights, 23.0)
    assert centre == pytest.approx([x, y], abs=1e-5)
    assert z0 == pytest.approx(z, abs=1e-5)
    assert max(std, rms) < 1e-5


@settings_of(max_examples=8)
@given(st.floats(-179.0, 179.0), st.floats(2.0, 5.0))
def test_the_yaw_of_the_image(yaw: float, scale: float) -> None:
    turn = np.linspace(0, 2 * np.pi, 9)[:-1]
    places = 4 * np.column_stack([np.cos(turn), np.sin(turn)])
    c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    flipped = places * [1.0, -1.0]
    seen = 64 + scale * np.column_stack(
        [c * flipped[:, 0] - s * flipped[:, 1], s * flipped[:, 0] + c * flipped[:, 1]]
    )
    found, std = fit_yaw(places, seen)
    assert (found - yaw + 180) % 360 - 180 == pytest.approx(0.0, abs=0.01)
    assert std < 0.01
