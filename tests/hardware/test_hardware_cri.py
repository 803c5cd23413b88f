"""The driver of any robot object of the cri convention."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import ModuleType

import pytest
from fake_station import finish

from tactibench import UserError
from tactibench_tactip import CriRobot, Pose6, RobotError, Settings

Make = Callable[..., Settings]


class Dobot:
    """A robot of the cri convention."""

    def __init__(self) -> None:
        self.pose = (0.0,) * 6
        self.linear_speed = 0.0
        self.axes = "rxyz"

    def move_linear(self, pose: Pose6) -> None:
        if pose[0] > 100.0:
            raise ValueError("out of reach")
        self.pose = pose

    def close(self) -> None: ...


@pytest.fixture
def make_robot(monkeypatch: pytest.MonkeyPatch, make: Make) -> Callable[[str], CriRobot]:
    module = ModuleType("dobot_of_the_lab")
    module.make = Dobot  # type: ignore[attr-defined]
    module.half = object  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return lambda name: CriRobot(
        make(robot={"driver": "cri", "address": f"dobot_of_the_lab:{name}"})
    )


def test_any_object_with_three_names(make_robot: Callable[[str], CriRobot]) -> None:
    robot = make_robot("make")
    robot.connect()
    robot.start((1.0, 2.0, 3.0, 0.0, 0.0, 0.0), 12.0, 500.0)
    finish(robot)
    assert robot.pose()[:3] == (1.0, 2.0, 3.0)
    assert robot._robot.linear_speed == 12.0
    assert robot._robot.axes == "sxyz"
    robot.start((200.0, 0.0, 0.0, 0.0, 0.0, 0.0), 12.0, 500.0)
    with pytest.raises(RobotError, match="out of reach"):
        finish(robot)
    robot.close()


@pytest.mark.parametrize(("name", "message"), [("half", "without 'move_linear'"), ("no", "needs")])
def test_what_is_no_robot(make_robot: Callable[[str], CriRobot], name: str, message: str) -> None:
    with pytest.raises(UserError, match=message):
        make_robot(name).connect()
