"""A stage behind the real client: homing that ends, a probe that stops when it is told."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import pytest
from fake_station import FakeCapture, make_settings

from tactibench_tactip.camera.driver import Camera
from tactibench_tactip.emulators import Fault, GrblEmulator, Rig, World, simulated
from tactibench_tactip.failures import StopNowError
from tactibench_tactip.motion.owner import Owner
from tactibench_tactip.robots.connect import connect_seconds
from tactibench_tactip.robots.grbl import GrblRobot
from tactibench_tactip.settings import Pose6, Settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch.search import NoTouchError, find_touch

pytestmark = pytest.mark.skipif(
    find_spec("serial") is None,
    reason="pyserial is not installed: pip install tactibench[serial]",
)
STAGE: Pose6 = (-100.0, -100.0, -70.0, 180.0, 0.0, 0.0)
RATES = {"$110": 6000.0, "$111": 6000.0, "$112": 6000.0}
SCALE = 40.0
"""Homing takes half a second."""
TRUE_Z0 = 0.6


@pytest.fixture
def world() -> Iterator[World]:
    rig = Rig(work_frame=STAGE, sensor_frame=(0.0, 0.0, TRUE_Z0, 180.0, 0.0, 0.0))
    with World(simulated("tactip-127"), rig, time_scale=SCALE) as found:
        yield found


@pytest.fixture
def stage(world: World) -> Iterator[GrblEmulator]:
    with GrblEmulator(world, link="socket", settings=RATES) as found:
        yield found


def settings_of(stage: GrblEmulator, **robot: Any) -> Settings:
    return make_settings(
        robot={"driver": "grbl", "address": stage.port, "time_scale": SCALE, "home": True, **robot},
        frames={"work_frame": list(STAGE), "tcp_pose": [0.0] * 6},
        contact={"method": "probe"},
    )


def stands(world: World) -> bool:
    before = world.tool()
    time.sleep(0.05)
    return world.tool() == before


class TestHoming:
    def test_may_take_longer_than_connecting(self, stage: GrblEmulator) -> None:
        settings = settings_of(stage, connect_s=0.05)
        assert connect_seconds(settings) > 60.0
        robot = GrblRobot(settings)
        with Owner(robot, settings):
            assert robot.at_switches

    def test_ends_when_somebody_asks_to_stop(self, stage: GrblEmulator, world: World) -> None:
        robot = GrblRobot(settings_of(stage))
        owner = Owner(robot, settings_of(stage))
        threading.Thread(target=_when_it_homes, args=(robot, owner.halt.set)).start()
        with pytest.raises(StopNowError), owner:
            pytest.fail("it was not connected")
        assert stands(world)
        assert stage._controller.state == "Alarm"

    def test_ends_when_the_robot_is_let_go(self, stage: GrblEmulator, world: World) -> None:
        robot = GrblRobot(settings_of(stage))
        failed: list[BaseException] = []

        def connect() -> None:
            try:
                robot.connect()
            except BaseException as error:  # noqa: BLE001 - looked at below
                failed.append(error)

        thread = threading.Thread(target=connect)
        thread.start()
        _when_it_homes(robot, robot.close)
        thread.join(5.0)
        assert failed
        assert stands(world)
        assert stage._controller.state == "Alarm"


def _when_it_homes(robot: GrblRobot, what: Any) -> None:
    end = time.monotonic() + 5.0
    while not robot._homing and time.monotonic() < end:
        time.sleep(0.002)
    time.sleep(0.1)
    what()


class TestProbe:
    @pytest.fixture
    def station(self, stage: GrblEmulator) -> Iterator[Station]:
        settings = settings_of(stage)
        camera = Camera(settings.camera, lambda _: FakeCapture())
        with camera, Station(settings, camera=camera) as found:
            yield found

    def test_finds_first_touch(self, station: Station) -> None:
        touch = find_touch(station, first=True)
        assert touch.z0_mm == pytest.approx(TRUE_Z0, abs=0.02)
        assert touch.spread_mm < 0.02

    def test_that_meets_nothing_is_told(self, station: Station, world: World) -> None:
        world.arm(Fault("alarm-5", value=100))
        with pytest.raises(NoTouchError, match="nothing was touched"):
            find_touch(station, first=True)
        assert station.owner.robot.state().normal
        assert world.tool()[2] <= -station.settings.envelope.clearance_mm + 0.1

    def test_stops_when_somebody_asks_to(self, station: Station, world: World) -> None:
        robot = station.owner.robot
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
