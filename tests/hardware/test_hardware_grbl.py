"""The driver of a stage, with pyserial, against an emulated GRBL controller."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from emulated import GraySensor, finish, stands
from fake_station import FakeCapture

from tactibench import UserError
from tactibench_tactip.camera import Camera
from tactibench_tactip.commands import doctor
from tactibench_tactip.emulators import Fault
from tactibench_tactip.emulators.grbl import GrblEmulator
from tactibench_tactip.emulators.touch import Rig
from tactibench_tactip.emulators.world import Clock, World
from tactibench_tactip.errors import NoTouchError, RobotError, StopNowError
from tactibench_tactip.motion import RobotThread
from tactibench_tactip.robots.base import connect_seconds
from tactibench_tactip.robots.grbl import GrblRobot
from tactibench_tactip.settings import Pose6, Settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch import find_touch

Make = Callable[..., Settings]
STAGE: Pose6 = (-100.0, -100.0, -70.0, 180.0, 0.0, 0.0)
RATES = {"$110": 6000.0, "$111": 6000.0, "$112": 6000.0}
SCALE = 40.0
"""Homing takes half a second."""
TRUE_Z0 = 0.6

pytest.importorskip("serial", reason="pyserial is not installed: pip install tactibench[serial]")
pytestmark = pytest.mark.long


@pytest.fixture
def world() -> World:
    rig = Rig(work_frame=STAGE, sensor_frame=(0.0, 0.0, TRUE_Z0, 180.0, 0.0, 0.0))
    return World(GraySensor(), rig, clock=Clock(SCALE))


@pytest.fixture
def stage(world: World) -> Iterator[GrblEmulator]:
    with GrblEmulator(world, settings=RATES) as stage:
        yield stage


@pytest.fixture
def keys(make: Make) -> Callable[..., Settings]:
    def settings(port: str, **robot: Any) -> Settings:
        return make(
            robot={"driver": "grbl", "address": port, "time_scale": SCALE, **robot},
            frames={"work_frame": list(STAGE), "tcp_pose": [0.0] * 6},
            contact={"method": "probe"},
        )

    return settings


def test_homed_it_goes_where_it_is_sent(stage: GrblEmulator, keys: Make) -> None:
    robot = GrblRobot(keys(stage.port, home=True))
    robot.connect()
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
    robot.start((*target[:2], -60.0, *target[3:]), 5.0, 500.0)
    robot.stop()
    finish(robot)
    assert -60.0 < robot.pose()[2] < -30.0
    robot.close()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, r"not homed.*robot.home = true"),
        ({"$22": 0.0, "$20": 0.0}, r"\$20=0; set \$20=1"),
        ({"$13": 1.0}, r"\$13=1; set \$13=0"),
        ({"$112": 600.0}, r"axis z of the stage reaches 10\.0 mm/s"),
    ],
)
def test_a_stage_that_is_not_ready_is_refused(
    world: World, keys: Make, settings: dict[str, float], message: str
) -> None:
    with GrblEmulator(world, settings={**RATES, **settings}) as stage:
        driver = GrblRobot(keys(stage.port))
        with pytest.raises(UserError, match=message):
            driver.connect()
        driver.close()


def test_doctor_takes_a_stage_that_homes_before_it_moves(
    stage: GrblEmulator, world: World, keys: Make
) -> None:
    """Opening the port resets it: it is never homed when it is looked at."""
    before = world.tool()
    rows = list(doctor._check("robot", doctor._robot, keys(stage.port, home=True)))
    assert [mark for mark, _, _ in rows] == ["ok", "ok"]
    assert "$20 1" in rows[0][2]
    assert "not yet" in rows[1][2]
    ((mark, _, text),) = doctor._check("robot", doctor._robot, keys(stage.port))
    assert (mark, "not homed" in text) == ("WRONG", True)
    assert world.tool() == before


def test_what_is_no_grbl_is_refused(keys: Make) -> None:
    with pytest.raises(UserError, match="cannot be opened"):
        GrblRobot(keys("socket://127.0.0.1:1")).connect()


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("alarm-1", "a limit switch was hit"),
        ("alarm-2", "position is kept"),
        ("alarm-3", "reset while it moved"),
        ("hold", "somebody at the stage paused it"),
    ],
)
def test_what_stops_it_is_said(
    world: World, stage: GrblEmulator, keys: Make, kind: str, message: str
) -> None:
    robot = GrblRobot(keys(stage.port, home=True))
    robot.connect()
    world.arm(Fault(kind))
    time.sleep(0.05)
    state = robot.state()
    assert not state.normal
    assert message in state.description
    robot.close()


def test_homing_may_take_longer_than_connecting(stage: GrblEmulator, keys: Make) -> None:
    settings = keys(stage.port, home=True, connect_s=0.05)
    assert connect_seconds(settings) > 60.0
    robot = GrblRobot(settings)
    with RobotThread(robot, settings):
        assert robot.at_switches


@pytest.mark.parametrize("by", ["halt", "close"])
def test_homing_ends_when_somebody_asks_to_stop(
    stage: GrblEmulator, world: World, keys: Make, by: str
) -> None:
    settings = keys(stage.port, home=True)
    robot = GrblRobot(settings)
    thread = RobotThread(robot, settings)
    stop = thread.halt.set if by == "halt" else robot.close
    helper = threading.Thread(target=_when_it_homes, args=(robot, stop))
    helper.start()
    with pytest.raises((StopNowError, RobotError)), thread:
        pytest.fail("it was connected")
    helper.join(5.0)
    assert stands(world)
    assert stage.controller.state == "Alarm"


@pytest.fixture
def station(stage: GrblEmulator, keys: Make) -> Iterator[Station]:
    settings = keys(stage.port, home=True)
    camera = Camera(settings.camera, lambda _: FakeCapture())
    with camera, Station(settings, camera=camera) as station:
        yield station


def test_a_probe_finds_first_touch(station: Station) -> None:
    touch = find_touch(station, first=True)
    assert touch.z0_mm == pytest.approx(TRUE_Z0, abs=0.02)
    assert touch.spread_mm < 0.02


def test_a_probe_that_meets_nothing_is_told(station: Station, world: World) -> None:
    world.arm(Fault("alarm-5", value=100))
    with pytest.raises(NoTouchError, match="nothing was touched"):
        find_touch(station, first=True)
    assert station.robot.state().normal
    assert world.tool()[2] <= -station.settings.envelope.clearance_mm + 0.1


def test_a_probe_stops_when_somebody_asks_to(station: Station, world: World) -> None:
    robot = station.robot
    assert isinstance(robot, GrblRobot)
    probe, depths = robot.probe, []

    def stopped(pose: Pose6, speed: float) -> Pose6 | None:
        depths.append(world.truth().depth_mm)
        station.stop_now()
        return probe(pose, speed)

    robot.probe = stopped  # type: ignore[method-assign]
    with pytest.raises(StopNowError):
        find_touch(station, first=True)
    assert len(depths) == 1
    assert world.tool()[2] <= -station.settings.envelope.clearance_mm + 0.1


def _when_it_homes(robot: GrblRobot, act: Callable[[], None]) -> None:
    end = time.monotonic() + 5.0
    while not robot._homing and time.monotonic() < end:
        time.sleep(0.002)
    time.sleep(0.1)
    act()
