"""Scenes as tips, against tactibench.geometry; scenes that are refused."""

import math

import numpy as np
import pytest
from hard_scenes import GRID, sensor
from hypothesis import given, settings
from hypothesis import strategies as st
from penetration import normal_penetration

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.geometry import plate_contact_xy, tip_depths, tip_positions, true_contacts
from tactibench_sim import check_reach, tips_of

numbers = st.floats(-8, 8)
INDENTERS = (
    Indenter.single(),
    Indenter.single(5.0),
    Indenter.dual(6.5),
    Indenter.triple((0.0, 1.5, 3.0)),
    Indenter(3.0, tuple((2.0 * k - 5, 0.3 * k, 0.1 * k) for k in range(6)), "six"),
)
scenes = st.builds(
    Scene,
    st.sampled_from(INDENTERS),
    st.builds(Pose, numbers, numbers, st.floats(-180, 180), st.just(0.0), st.floats(0, 6)),
)


@settings(max_examples=30)
@given(st.lists(scenes, min_size=1, max_size=5))
def test_batches_equal_the_closed_forms_one_by_one(several):
    tips = tips_of(several)
    n, delta = tips.directions()
    for row, scene in enumerate(several):
        count = len(scene.indenter.offsets)
        assert tips.xy[row, :count] == pytest.approx(tip_positions(scene)[:, :2], abs=1e-12)
        assert tips.depth[row, :count] == pytest.approx(tip_depths(scene), abs=1e-12)
        assert delta[row, :count] == pytest.approx(normal_penetration(scene), abs=1e-11)
        assert (tips.depth[row, count:] == -np.inf).all()
        assert np.hypot(*n[row, :count, :2].T) == pytest.approx(
            np.hypot(*tip_positions(scene)[:, :2].T)
            / (20 + scene.indenter.radius - normal_penetration(scene)),
            abs=1e-12,
        )
        assert (tips.depth[row] > 0).sum() == len(true_contacts(scene))


@settings(max_examples=30)
@given(st.floats(-20, 20), st.floats(-180, 180), st.floats(0.1, 6))
def test_a_plate_touches_where_its_normal_points(tilt, yaw, depth):
    scene = Scene(Indenter.plate(), Pose(1.0, 2.0, yaw, tilt, depth))
    tips = tips_of([scene, Scene(Indenter.dual(7), Pose(depth=1.0))])
    n, delta = tips.directions()
    assert 20 * n[0, 0, :2] == pytest.approx(plate_contact_xy(scene), abs=1e-12)
    assert n[0, 0, 2] == pytest.approx(math.cos(math.radians(tilt)))
    assert delta[0, 0] == depth
    assert delta[0, 1] == -np.inf


def test_a_tip_beside_the_dome_is_none():
    tips = tips_of([Scene(Indenter.dual(60.0), Pose(x=30.0, depth=1.0))])
    _, delta = tips.directions()
    assert list(delta[0]) == [pytest.approx(1.0), -np.inf]


def test_a_steep_tip_that_does_not_touch_is_allowed():
    scene = Scene(Indenter(3.0, ((0, 0, 0), (21.0, 0, -8.0)), "odd"), Pose(depth=0.5))
    check_reach(*tips_of([scene]).directions(), 6.5)


@pytest.mark.parametrize(
    ("scene", "named"),
    [
        *(
            (Scene(indenter, Pose(**{"depth": 1.0, name: value})), f"{name} {value}.*be finite")
            for name in ("x", "y", "yaw", "tilt", "depth")
            for value, indenter in ((math.nan, Indenter.dual(7.0)), (-math.inf, Indenter.plate()))
        ),
        (Scene(Indenter.single(0.5), Pose(depth=0.3)), "radius is 0.5 mm"),
        (Scene(Indenter.single(), Pose(x=150.0, depth=1)), "must be within 100 mm"),
        (Scene(Indenter.single(), Pose(tilt=5.0, depth=1)), "tilt is 5 deg"),
        (Scene(Indenter.plate(), Pose(tilt=95.0, depth=1)), "tilt is 95 deg"),
        (Scene(Indenter.single(), Pose(depth=6.6)), r"tables end at 6.5 mm, press less deep"),
        (Scene(Indenter.dual(7.0), Pose(depth=25.0)), "less than the dome's radius"),
        (Scene(Indenter.single(), Pose(depth=-0.1)), "depth is -0.1 mm; it must be 0 or more"),
        (Scene(Indenter.single(), Pose(x=20.5, depth=1)), "beyond 55 deg"),
        (Scene(Indenter.dual(40.0), Pose(depth=1)), "beyond 55 deg"),
        (
            Scene(Indenter(1.0, ((0.0, 0.0, 0.0),) * 13, "brush"), Pose(depth=1)),
            "13 tips.*press fewer",
        ),
        (Scene(Indenter.plate(), Pose(tilt=60.0, depth=1)), "beyond 55 deg"),
    ],
)
def test_bad_scenes_are_refused(scene, named):
    one = sensor("coupled")
    for call in (one.press, one.bound, lambda scene: one.surface(scene, GRID)):
        with pytest.raises(UserError, match=named) as caught:
            call(scene)
        assert str(caught.value).endswith(".")
