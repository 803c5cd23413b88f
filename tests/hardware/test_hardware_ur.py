"""The driver of a UR, with ur_rtde, against an emulated controller, and what it refuses."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec

import numpy as np
import pytest
from emulated import GraySensor, finish, stands

from tactibench import UserError
from tactibench_tactip.emulators import Fault
from tactibench_tactip.emulators.ur import UrEmulator
from tactibench_tactip.emulators.world import Clock, World
from tactibench_tactip.errors import RobotError, RobotLostError
from tactibench_tactip.poses import angle_between
from tactibench_tactip.robots.ur import (
    Dashboard,
    UrRobot,
    describe_safety,
    is_normal,
    is_protective_stop,
)
from tactibench_tactip.settings import Pose6, Settings

Make = Callable[..., Settings]
SCALE = 40.0
HOST = "127.0.0.97"
needs_rtde = pytest.mark.skipif(
    find_spec("rtde_control") is None, reason="ur_rtde is not installed (no wheel for Python 3.13)"
)


@pytest.fixture
def world() -> World:
    return World(GraySensor(), clock=Clock(SCALE))


@pytest.fixture
def arm(world: World) -> Iterator[UrEmulator]:
    with UrEmulator(world, HOST) as arm:
        yield arm


@pytest.fixture
def robot(arm: UrEmulator, make: Make) -> Iterator[UrRobot]:
    keys = {"address": arm.host, "time_scale": SCALE, "watchdog_hz": 2.0}
    robot = UrRobot(make(robot=keys))
    robot.connect()
    yield robot
    robot.close()


def test_local_mode_is_refused(world: World, make: Make) -> None:
    with UrEmulator(world, HOST, remote=False) as arm:
        robot = UrRobot(make(robot={"address": arm.host}))
        with pytest.raises(UserError, match=r"local mode; switch it to remote control"):
            robot.connect()
        robot.close()


def test_a_robot_that_is_not_there(make: Make) -> None:
    with pytest.raises(UserError, match=r"answers as a UR does.*robot\.address"):
        UrRobot(make(robot={"address": "127.0.0.98"})).connect()


def test_the_dashboard_says_what_it_is(arm: UrEmulator) -> None:
    board = Dashboard(arm.host)
    board.check_ready()
    assert "5.12" in board.version
    board.close()


@needs_rtde
@pytest.mark.long
def test_registers_of_a_fieldbus_are_refused(world: World, make: Make) -> None:
    with UrEmulator(world, HOST, in_use=("input_int_register_0",)) as arm:
        robot = UrRobot(make(robot={"address": arm.host, "time_scale": SCALE}))
        with pytest.raises(UserError, match=r"already in use.*fieldbus"):
            robot.connect()
        robot.close()


@needs_rtde
@pytest.mark.long
def test_another_tcp_on_the_pendant_is_refused_before_it_is_replaced(
    world: World, make: Make
) -> None:
    with UrEmulator(world, HOST, tool=(0.0, 0.0, 50.0, 0.0, 0.0, 0.0)) as arm:
        keys = {"address": arm.host, "time_scale": SCALE, "watchdog_hz": 2.0}
        robot = UrRobot(make(robot=keys))
        with pytest.raises(UserError, match=r"TCP is 0\.0, -?0\.0, 50\.0.*robot\.set_tcp = true"):
            robot.connect()
        robot.close()
        before = arm.controller.pose()
        robot = UrRobot(make(robot={**keys, "set_tcp": True}))
        robot.connect()
        assert 1000.0 * np.linalg.norm(arm.controller.pose() - before) == pytest.approx(39.1)
        assert robot.describe()["speed_slider"] == "100 %"
        robot.close()


@needs_rtde
@pytest.mark.long
def test_the_process_of_the_arm_has_a_group_in_our_session(robot: UrRobot) -> None:
    """Ctrl-C does not reach it; a session of its own would be starved by the kernel."""
    process = robot._link._process.pid
    assert os.getsid(process) == os.getsid(0)
    assert os.getpgid(process) == process


@needs_rtde
@pytest.mark.long
def test_it_goes_where_it_is_sent_and_stops(robot: UrRobot, world: World) -> None:
    start = robot.pose()
    target: Pose6 = (start[0] + 3.0, start[1], start[2] - 5.0, *start[3:])
    robot.start(target, 20.0, 500.0)
    finish(robot)
    assert robot.pose()[:3] == pytest.approx(target[:3], abs=0.02)
    assert angle_between(robot.pose(), target) < 0.01
    state = robot.state()
    assert state.normal
    assert state.force_n is not None
    robot.start(start, 0.5, 500.0)
    robot.stop()
    finish(robot)
    assert robot.pose()[2] < start[2] - 0.5
    assert stands(world)
    robot.close()
    with pytest.raises(RobotLostError):
        robot.state()


@needs_rtde
@pytest.mark.long
def test_a_protective_stop_is_released_where_an_ended_program_is_told(
    robot: UrRobot, world: World
) -> None:
    pose = robot.pose()
    world.arm(Fault("protective-stop"), Fault("unlock-refused", value=1))
    _until(lambda: robot.state().stopped)
    with pytest.raises(RobotError, match=r"the UR refuses.*protective stop"):
        robot.start(pose, 5.0, 500.0)
    robot.recover()
    assert robot.state().normal
    with pytest.raises(RobotError, match="only a protective stop is released"):
        robot.recover()
    robot.start((*pose[:2], pose[2] + 2.0, *pose[3:]), 5.0, 500.0)
    finish(robot)
    assert robot.pose()[2] == pytest.approx(pose[2] + 2.0, abs=0.02)
    world.arm(Fault("program-stop"))
    _until(lambda: not robot.state().normal)
    assert "its control program ended" in robot.state().description
    with pytest.raises(RobotError, match="control program") as caught:
        robot.start(pose, 5.0, 500.0)
    assert "safety limits" not in str(caught.value)


@needs_rtde
@pytest.mark.long
def test_a_stream_that_freezes_is_a_lost_arm(robot: UrRobot, world: World) -> None:
    world.arm(Fault("frozen-stream", value=SCALE * 60))
    with pytest.raises(RobotLostError, match="sends nothing any more"):
        _until(lambda: robot.state() is None)


@pytest.mark.parametrize(
    ("bits", "mode", "message", "normal", "protective"),
    [
        (0b1, 7, "normal", True, False),
        (0b10, 7, "reduced", True, False),
        (0b100, 7, "protective stop", False, True),
        (0b1000000100, 7, "protective stop, safety fault", False, False),
        (0b11000000, 7, "emergency stop of the robot, emergency stop", False, False),
        (0b1, 3, "power off", True, False),
    ],
)
def test_safety_bits(bits: int, mode: int, message: str, normal: bool, protective: bool) -> None:
    assert describe_safety(bits, mode) == message
    assert is_normal(bits) == normal
    assert is_protective_stop(bits) == protective


def _until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.01)
