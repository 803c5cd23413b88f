"""What cannot be computed is refused by name."""

import math

import pytest
from hard_scenes import GRID, every_sensor, sensor

from tactibench import Indenter, Pose, Scene, UserError


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
        (Scene(Indenter.plate(), Pose(tilt=95.0, depth=1)), "tilt is 95 deg"),
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
        with pytest.raises(UserError, match=f"{name} {value}.*must be finite"):
            call(scene)
