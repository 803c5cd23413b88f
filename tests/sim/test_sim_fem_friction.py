"""A plate that sticks: what it has touched stays where it touched."""

import math

import numpy as np
import pytest
from dome_press import press

from tactibench_sim.fem import Dome
from tactibench_sim.fem.continuation import Settings

pytest.importorskip("ngsolve", reason="needs the extra `fem`")
DOME = Dome(apex_size=0.5, skin_size=0.8, gel_size=4.0)
POLAR = np.radians(np.arange(0, 91, 0.5))
DEPTHS = np.array([0.4, 0.7, 1.0])


def places(profile):
    """Distance from the axis of the outer skin's points."""
    w, t = profile.outer
    return (DOME.outer - w) * np.sin(POLAR) + t * np.cos(POLAR)


def touching(profile):
    """Well inside the contact: undeformed height above the plate by a quarter of its depth."""
    return DOME.outer * (1 - np.cos(POLAR)) < profile.delta / 4


@pytest.fixture(scope="module")
def runs():
    return {
        friction: list(press(DOME, math.inf, DEPTHS, POLAR, friction=friction))
        for friction in ("none", "stick")
    }


def test_what_has_touched_stays(runs):
    first, *later = runs["stick"]
    for profile in later:
        assert places(profile)[touching(first)] == pytest.approx(
            places(first)[touching(first)], abs=5e-3
        )


def test_without_friction_it_slides(runs):
    first, *_, last = runs["none"]
    assert abs(places(last) - places(first))[touching(first)].max() > 0.01


def test_sticking_takes_more_force_at_small_depth(runs):
    for free, stuck in zip(runs["none"], runs["stick"], strict=True):
        assert free.force < stuck.force < 1.1 * free.force


@pytest.mark.slow
def test_increments_are_small_enough():
    """Against a quarter of the increment: pin bases within 0.01 mm, force within 1 %."""
    depths = np.array([1.0, 2.0, 4.0])
    usual = press(DOME, math.inf, depths, POLAR, friction="stick")
    fine = press(DOME, math.inf, depths, POLAR, friction="stick", settings=Settings(largest=0.0125))
    for one, other in zip(usual, fine, strict=True):
        assert one.inner == pytest.approx(other.inner, abs=0.01)
        assert one.force == pytest.approx(other.force, rel=0.01)
