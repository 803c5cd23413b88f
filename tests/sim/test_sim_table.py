"""The shipped table: reference figures, and what mechanics demands."""

import math

import numpy as np
import pytest
from hard_scenes import enclosed_volume

from tactibench_sim import shipped_dome

TABLES = shipped_dome()
SPHERE, PLATE = TABLES.by_radius[3.0], TABLES.by_radius[math.inf]
BOTH = pytest.mark.parametrize("one", [SPHERE, PLATE], ids=["sphere", "plate"])


def test_forces_of_an_independent_feasibility_run():
    """Same dome, another code and mesh; its figures carry two or three digits."""
    depths = np.array([0.25, 0.5, 1.0, 1.5, 2.0])
    force = np.interp(depths, SPHERE.delta, SPHERE.fields["force"])
    assert force == pytest.approx([0.043, 0.088, 0.173, 0.259, 0.353], rel=0.012)


def test_profile_of_an_independent_feasibility_run():
    at = np.radians([0.5, 5, 10, 15, 20, 30, 40])
    w = SPHERE.fields["w"][np.searchsorted(SPHERE.delta, 1.0)]
    told = [0.96, 0.67, 0.35, 0.16, 0.06, -0.004, -0.019]
    assert np.interp(at, SPHERE.polar, w) == pytest.approx(told, abs=0.025)


@BOTH
def test_force_grows_with_depth(one):
    assert one.fields["force"][0] == 0
    assert (np.diff(one.fields["force"]) > 0).all()


@BOTH
def test_nothing_moves_at_depth_zero_and_at_the_rim(one):
    for name in ("w", "t", "omega", "w_outer", "t_outer"):
        assert abs(one.fields[name][0]).max() < 1e-9
    for name in ("w", "t", "w_outer", "t_outer"):
        assert abs(one.fields[name][:, -1]).max() < 1e-5


@BOTH
def test_the_skin_is_where_the_indenter_is(one):
    """At the apex the outer skin has moved by the penetration, but for the contact's stiffness."""
    assert one.fields["w_outer"][:, 0] == pytest.approx(one.delta, abs=0.004)


@BOTH
@pytest.mark.parametrize(("which", "radius"), [("", 19.0), ("_outer", 20.0)])
def test_enclosed_volume_is_conserved(one, which, radius):
    """What the dimple takes the bulge gives, to 1 % of the dimple: nu is 1/2 exactly."""
    start = enclosed_volume(radius, one.polar, 0 * one.polar, 0 * one.polar)
    for row in (4, 8, 24, 48, 52):
        w, t = one.fields[f"w{which}"][row], one.fields[f"t{which}"][row]
        dimple = start - enclosed_volume(radius, one.polar, np.maximum(w, 0), 0 * w)
        assert abs(enclosed_volume(radius, one.polar, w, t) - start) < 0.01 * dimple
