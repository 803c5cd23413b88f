"""What cannot be computed is refused by name."""

import math

import numpy as np
import pytest
from hard_scenes import GRID, every_sensor, sensor

from tactibench import Indenter, Pose, Scene, UserError
from tactibench_sim import fem

# -- what does not converge raises


def test_finite_elements_that_do_not_converge_raise():
    pytest.importorskip("ngsolve", reason="needs the extra `fem`")
    from dome_press import press

    from tactibench_sim.fem.continuation import Settings

    body = fem.Dome(apex_size=0.5, skin_size=1.0, gel_size=4.0)
    hasty = Settings(first=19.5, smallest=10.0, steps=5)
    run = press(body, 3.0, np.array([19.5]), np.zeros(1), settings=hasty)
    with pytest.raises(fem.NotConvergedError, match="did not converge"):
        next(run)
    assert list(run) == []  # and no field comes after it


# -- bad input


def calls(tier):
    one = sensor(tier)
    return (
        one.press,
        one.bound,
        lambda scene: one.surface(scene, GRID),
        lambda scene: list(one.press_many([scene])),
    )


@every_sensor
@pytest.mark.parametrize(
    ("scene", "named"),
    [
        (Scene(Indenter.single(), Pose(x=150.0, depth=1)), "must be within 100 mm"),
        (Scene(Indenter.single(), Pose(y=-1e9, depth=1)), "must be within 100 mm"),
        (Scene(Indenter.single(), Pose(tilt=5.0, depth=1)), "tilt is 5 deg"),
        (Scene(Indenter.plate(), Pose(tilt=95.0, depth=1)), r"within \+-90"),
        (Scene(Indenter.single(), Pose(depth=6.6)), r"tables end at 6.5 mm, press less deep"),
        (Scene(Indenter.plate(), Pose(depth=7.0)), r"tables end at 6.5 mm, press less deep"),
        (Scene(Indenter.dual(7.0), Pose(depth=25.0)), "less than the dome's radius"),
        (Scene(Indenter.single(), Pose(depth=-0.1)), "depth is -0.1 mm; it must be 0 or more"),
        (Scene(Indenter.plate(), Pose(depth=-0.1)), "depth is -0.1 mm; it must be 0 or more"),
        (Scene(Indenter.single(), Pose(x=20.5, depth=1)), "beyond 55 deg"),
        (Scene(Indenter.dual(40.0), Pose(depth=1)), "beyond 55 deg"),
        (Scene(Indenter.plate(), Pose(tilt=60.0, depth=1)), "beyond 55 deg"),
    ],
)
def test_bad_scenes_are_refused(tier, scene, named):
    for call in calls(tier):
        with pytest.raises(UserError, match=named) as caught:
            call(scene)
        assert str(caught.value).endswith(".")


@every_sensor
@pytest.mark.parametrize("name", ["x", "y", "yaw", "tilt", "depth"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("indenter", [Indenter.dual(7.0), Indenter.plate()], ids=lambda i: i.name)
def test_a_pose_that_is_not_finite_is_refused(tier, name, value, indenter):
    scene = Scene(indenter, Pose(**{"depth": 1.0, name: value}))
    for call in calls(tier):
        with pytest.raises(UserError, match=f"pose's {name} is {value}"):
            call(scene)


@every_sensor
@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_indenter_that_is_not_finite_is_refused(tier, axis, value):
    offset = [0.0, 0.0, 0.0]
    offset[axis] = value
    with pytest.raises((UserError, ValueError), match="offset"):
        sensor(tier).press(Scene(Indenter(3.0, ((1.0, 0, 0), tuple(offset)), "odd"), Pose(depth=1)))


@every_sensor
def test_a_radius_without_tables_is_refused_with_the_range(tier):
    for call in calls(tier):
        with pytest.raises(UserError, match=r"radius is 9 mm.*1 to 8 mm.*sensor.tier=fem"):
            call(Scene(Indenter.single(9.0), Pose(depth=1.0)))


@every_sensor
def test_a_depth_beyond_the_tables_of_a_tip_is_refused_with_the_range(tier):
    for radius, end in ((1.0, "1.5"), (3.0, "6.5"), (8.0, "4")):
        scene = Scene(Indenter.single(radius), Pose(depth=float(end) + 0.2))
        for call in calls(tier):
            with pytest.raises(UserError, match=rf"tables end at {end} mm.*sensor\.tier=fem"):
                call(scene)


def test_a_radius_that_is_none_cannot_be_made():
    for radius in (0.0, -3.0, math.nan):
        with pytest.raises(ValueError, match="must be positive"):
            Indenter.single(radius)
