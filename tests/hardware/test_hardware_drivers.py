"""Drivers against emulated controllers, and what they refuse."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import pytest

from tactibench import UserError
from tactibench_tactip.emulators import GrblEmulator, Rig, UrEmulator, World, simulated
from tactibench_tactip.failures import RobotError, RobotLostError
from tactibench_tactip.robots.cri import CriRobot
from tactibench_tactip.robots.grbl import GrblRobot
from tactibench_tactip.robots.ur import UrRobot
from tactibench_tactip.robots.ur_dashboard import Dashboard
from tactibench_tactip.robots.ur_safety import normal, protective, safety_words
from tactibench_tactip.settings import Pose6, Settings

STAGE: Pose6 = (-100.0, -100.0, -70.0, 180.0, 0.0, 0.0)
RATES = {"$110": 6000.0, "$111": 6000.0, "$112": 6000.0}
Make = Callable[..., Settings]


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World(simulated("tactip-127"), Rig(work_frame=STAGE), time_scale=500.0) as found:
        yield found


def stage_keys(port: str, **robot: Any) -> dict[str, Any]:
    return {
        "robot": {"driver": "grbl", "address": port, "time_scale": 500.0, **robot},
        "frames": {"work_frame": list(STAGE), "tcp_pose": [0.0] * 6},
    }


def finish(robot: Any) -> None:
    while robot.moving():
        robot.tick()


@pytest.mark.skipif(
    find_spec("serial") is None,
    reason="pyserial is not installed: pip install tactibench[serial]",
)
class TestGrbl:
    @pytest.fixture
    def stage(self, world: World) -> Iterator[GrblEmulator]:
        with GrblEmulator(world, link="socket", settings=RATES) as found:
            yield found

    def test_homed_it_goes_where_it_is_sent(self, stage: GrblEmulator, make: Make) -> None:
        robot = GrblRobot(make(**stage_keys(stage.port, home=True)))
        robot.connect()
        try:
            assert robot.at_switches
            target: Pose6 = (-100.0, -95.0, -30.0, 180.0, 0.0, 0.0)
            robot.start(target, 50.0, 500.0)
            finish(robot)
            assert robot.pose() == pytest.approx(target, abs=0.01)
            assert robot.state().normal
            assert robot.describe()["$20"] == "1"
            with pytest.raises(RobotError, match="cannot turn"):
                robot.start((*target[:3], 180.0, 0.0, 30.0), 5.0, 500.0)
            with pytest.raises(RobotError, match="beyond the stage's travel"):
                robot.start((10.0, *target[1:]), 5.0, 500.0)
        finally:
            robot.close()

    @pytest.mark.parametrize(
        ("settings", "robot", "words"),
        [
            ({}, {}, r"not homed.*robot.home = true"),
            ({"$22": 0.0, "$20": 0.0}, {}, r"\$20=0; set \$20=1"),
            ({"$13": 1.0}, {}, r"\$13=1; set \$13=0"),
            ({"$112": 600.0}, {}, r"axis z of the stage reaches 10\.0 mm/s"),
        ],
    )
    def test_a_stage_that_is_not_ready_is_refused(
        self,
        world: World,
        make: Make,
        settings: dict[str, float],
        robot: dict[str, Any],
        words: str,
    ) -> None:
        with GrblEmulator(world, link="socket", settings={**RATES, **settings}) as stage:
            driver = GrblRobot(make(**stage_keys(stage.port, **robot)))
            with pytest.raises(UserError, match=words):
                driver.connect()
            driver.close()

    def test_what_is_no_grbl_is_refused(self, make: Make) -> None:
        with pytest.raises(UserError, match="cannot be opened"):
            GrblRobot(make(**stage_keys("socket://127.0.0.1:1"))).connect()


class TestUr:
    @pytest.fixture
    def arm(self, world: World) -> Iterator[UrEmulator]:
        with UrEmulator(world, "127.0.0.97") as found:
            yield found

    def test_local_mode_is_refused(self, world: World, make: Make) -> None:
        with UrEmulator(world, "127.0.0.97", remote=False) as arm:
            robot = UrRobot(make(robot={"address": arm.host}))
            with pytest.raises(UserError, match=r"local mode; switch it to remote control"):
                robot.connect()
            robot.close()

    def test_a_robot_that_is_not_there(self, make: Make) -> None:
        with pytest.raises(UserError, match=r"answers as a UR does.*robot\.address"):
            UrRobot(make(robot={"address": "127.0.0.98"})).connect()

    def test_the_dashboard_says_what_it_is(self, arm: UrEmulator) -> None:
        board = Dashboard(arm.host)
        board.demand_ready()
        assert "5.12" in board.version
        board.close()

    def test_it_goes_where_it_is_sent(self, arm: UrEmulator, make: Make, world: World) -> None:
        pytest.importorskip("rtde_control", reason="ur_rtde is not installed")
        keys = {"address": arm.host, "time_scale": 500.0, "watchdog_hz": 2.0}
        robot = UrRobot(make(robot=keys))
        robot.connect()
        try:
            x, y, z, *turn = robot.pose()
            target: Pose6 = (x + 3.0, y, z - 5.0, *turn)  # type: ignore[assignment]
            robot.start(target, 20.0, 500.0)
            finish(robot)
            assert robot.pose()[:3] == pytest.approx(target[:3], abs=0.02)
            state = robot.state()
            assert state.normal
            assert state.force_n is not None
            robot.stop()
        finally:
            robot.close()
        with pytest.raises(RobotLostError):
            robot.state()

    @pytest.mark.parametrize(
        ("bits", "mode", "words", "is_normal", "is_protective"),
        [
            (0b1, 7, "normal", True, False),
            (0b10, 7, "reduced", True, False),
            (0b100, 7, "protective stop", False, True),
            (0b1000000100, 7, "protective stop, safety fault", False, False),
            (0b11000000, 7, "emergency stop of the robot, emergency stop", False, False),
            (0b1, 3, "power off", True, False),
        ],
    )
    def test_safety_bits(
        self, bits: int, mode: int, words: str, is_normal: bool, is_protective: bool
    ) -> None:
        assert safety_words(bits, mode) == words
        assert normal(bits) == is_normal
        assert protective(bits) == is_protective


class Dobot:
    """What a robot of the cri convention has."""

    def __init__(self) -> None:
        self.pose = (0.0,) * 6
        self.linear_speed = 0.0
        self.axes = "rxyz"
        self.closed = False

    def move_linear(self, pose: Pose6) -> None:
        if pose[0] > 100.0:
            raise ValueError("out of reach")
        self.pose = pose

    def close(self) -> None:
        self.closed = True


class TestCri:
    @pytest.fixture
    def module(self, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
        module = ModuleType("dobot_of_the_lab")
        module.make = Dobot  # type: ignore[attr-defined]
        module.half = object  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)
        return module

    def robot(self, make: Make, name: str) -> CriRobot:
        return CriRobot(make(robot={"driver": "cri", "address": f"dobot_of_the_lab:{name}"}))

    def test_any_object_with_three_names(self, module: ModuleType, make: Make) -> None:
        robot = self.robot(make, "make")
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

    @pytest.mark.parametrize(
        ("name", "words"), [("half", "without 'move_linear'"), ("no", "needs")]
    )
    def test_what_is_no_robot(self, module: ModuleType, make: Make, name: str, words: str) -> None:
        with pytest.raises(UserError, match=words):
            self.robot(make, name).connect()
