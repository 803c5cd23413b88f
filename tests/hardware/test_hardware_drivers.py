"""Drivers with their real client libraries against emulated controllers, and what they refuse."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import pytest
from emulated import GraySensor
from fake_station import FakeCapture

from tactibench import UserError
from tactibench_tactip.camera import Camera
from tactibench_tactip.emulators import Clock, Fault, GrblEmulator, Rig, UrEmulator, World
from tactibench_tactip.errors import NoTouchError, RobotError, RobotLostError, StopNowError
from tactibench_tactip.motion import RobotThread
from tactibench_tactip.poses import angle_between
from tactibench_tactip.robots.base import connect_seconds
from tactibench_tactip.robots.cri import CriRobot
from tactibench_tactip.robots.grbl import GrblRobot
from tactibench_tactip.robots.grbl_link import GrblLink
from tactibench_tactip.robots.ur import (
    Dashboard,
    UrRobot,
    describe_safety,
    is_normal,
    is_protective_stop,
)
from tactibench_tactip.settings import Pose6, Settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch import find_touch

STAGE: Pose6 = (-100.0, -100.0, -70.0, 180.0, 0.0, 0.0)
RATES = {"$110": 6000.0, "$111": 6000.0, "$112": 6000.0}
SCALE = 40.0
"""Homing takes half a second."""
TRUE_Z0 = 0.6
HOST = "127.0.0.97"
Make = Callable[..., Settings]

needs_serial = pytest.mark.skipif(
    find_spec("serial") is None, reason="pyserial is not installed: pip install tactibench[serial]"
)
needs_rtde = pytest.mark.skipif(
    find_spec("rtde_control") is None, reason="ur_rtde is not installed (no wheel for Python 3.13)"
)


def finish(robot: Any) -> None:
    while robot.moving():
        robot.tick()


def stands(world: World) -> bool:
    before = world.tool()
    time.sleep(0.05)
    return world.tool() == before


@needs_serial
@pytest.mark.long
class TestGrbl:
    @pytest.fixture
    def world(self) -> World:
        rig = Rig(work_frame=STAGE, sensor_frame=(0.0, 0.0, TRUE_Z0, 180.0, 0.0, 0.0))
        return World(GraySensor(), rig, clock=Clock(SCALE))

    @pytest.fixture
    def stage(self, world: World) -> Iterator[GrblEmulator]:
        with GrblEmulator(world, settings=RATES) as stage:
            yield stage

    @pytest.fixture
    def keys(self, make: Make) -> Callable[..., Settings]:
        def settings(port: str, **robot: Any) -> Settings:
            return make(
                robot={"driver": "grbl", "address": port, "time_scale": SCALE, **robot},
                frames={"work_frame": list(STAGE), "tcp_pose": [0.0] * 6},
                contact={"method": "probe"},
            )

        return settings

    def test_homed_it_goes_where_it_is_sent(self, stage: GrblEmulator, keys: Make) -> None:
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
        ("settings", "words"),
        [
            ({}, r"not homed.*robot.home = true"),
            ({"$22": 0.0, "$20": 0.0}, r"\$20=0; set \$20=1"),
            ({"$13": 1.0}, r"\$13=1; set \$13=0"),
            ({"$112": 600.0}, r"axis z of the stage reaches 10\.0 mm/s"),
        ],
    )
    def test_a_stage_that_is_not_ready_is_refused(
        self, world: World, keys: Make, settings: dict[str, float], words: str
    ) -> None:
        with GrblEmulator(world, settings={**RATES, **settings}) as stage:
            driver = GrblRobot(keys(stage.port))
            with pytest.raises(UserError, match=words):
                driver.connect()
            driver.close()

    def test_what_is_no_grbl_is_refused(self, keys: Make) -> None:
        with pytest.raises(UserError, match="cannot be opened"):
            GrblRobot(keys("socket://127.0.0.1:1")).connect()

    @pytest.mark.parametrize(
        ("kind", "words"),
        [
            ("alarm-1", "a limit switch was hit"),
            ("alarm-2", "position is kept"),
            ("alarm-3", "reset while it moved"),
            ("hold", "somebody at the stage paused it"),
        ],
    )
    def test_what_stops_it_is_said(
        self, world: World, stage: GrblEmulator, keys: Make, kind: str, words: str
    ) -> None:
        robot = GrblRobot(keys(stage.port, home=True))
        robot.connect()
        world.arm(Fault(kind))
        time.sleep(0.05)
        state = robot.state()
        assert not state.normal
        assert words in state.description
        robot.close()

    def test_homing_may_take_longer_than_connecting(self, stage: GrblEmulator, keys: Make) -> None:
        settings = keys(stage.port, home=True, connect_s=0.05)
        assert connect_seconds(settings) > 60.0
        robot = GrblRobot(settings)
        with RobotThread(robot, settings):
            assert robot.at_switches

    @pytest.mark.parametrize("by", ["halt", "close"])
    def test_homing_ends_when_somebody_asks_to_stop(
        self, stage: GrblEmulator, world: World, keys: Make, by: str
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
    def station(self, stage: GrblEmulator, keys: Make) -> Iterator[Station]:
        settings = keys(stage.port, home=True)
        camera = Camera(settings.camera, lambda _: FakeCapture())
        with camera, Station(settings, camera=camera) as station:
            yield station

    def test_a_probe_finds_first_touch(self, station: Station) -> None:
        touch = find_touch(station, first=True)
        assert touch.z0_mm == pytest.approx(TRUE_Z0, abs=0.02)
        assert touch.spread_mm < 0.02

    def test_a_probe_that_meets_nothing_is_told(self, station: Station, world: World) -> None:
        world.arm(Fault("alarm-5", value=100))
        with pytest.raises(NoTouchError, match="nothing was touched"):
            find_touch(station, first=True)
        assert station.robot.state().normal
        assert world.tool()[2] <= -station.settings.envelope.clearance_mm + 0.1

    def test_a_probe_stops_when_somebody_asks_to(self, station: Station, world: World) -> None:
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


@needs_serial
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
class TestGrblLink:
    """On a pseudo-terminal, as a real port is one."""

    @pytest.fixture
    def port(self) -> Iterator[tuple[GrblLink, int]]:
        master, slave = os.openpty()
        link = GrblLink(os.ttyname(slave))
        os.close(slave)
        yield link, master
        link.close()
        with suppress(OSError):
            os.close(master)

    @pytest.mark.parametrize(
        ("line", "state", "position"),
        [
            ("<Idle|MPos:1.000,-2.000,3.5|FS:0,0>", "Idle", (1.0, -2.0, 3.5)),
            ("<Hold:0|WPos:1.0,1.0,1.0|Bf:15,128|WCO:1.0,2.0,3.0>", "Hold", (2.0, 3.0, 4.0)),
            ("<Run|FS:0,0|WPos:0,0,0>", "Run", (1.0, 2.0, 3.0)),
            ("<Idle|MPos:1.0,x,3.0>", None, None),
            ("<Idle|MPos:1.0,2.0", None, None),
            ("ok", None, None),
        ],
    )
    def test_reports(
        self,
        port: tuple[GrblLink, int],
        line: str,
        state: str | None,
        position: tuple[float, float, float] | None,
    ) -> None:
        link, _ = port
        link.parse_status("<Idle|WPos:0,0,0|WCO:1.0,2.0,3.0>")  # the offset is remembered
        status = link.parse_status(line)
        assert (status and status.state, status and status.position) == (state, position)

    def test_answers_refusals_and_silence(self, port: tuple[GrblLink, int]) -> None:
        link, master = port
        os.write(master, b"Grbl 1.1h ['$' for help]\r\n")
        link.wait_banner(2.0)
        assert link.banner.startswith("Grbl 1.1h")
        for answer, words in (
            (b"error:15\r\n", "beyond the stage's travel"),
            (b"error:\xff\r\n", "damaged"),
            (b"", "did not answer"),
        ):
            timer = threading.Timer(0.05, os.write, (master, answer))
            timer.start()
            with pytest.raises(RobotError, match=words):
                link.command("$J=X1", 0.2)
            timer.join()
        timer = threading.Timer(0.05, os.write, (master, b"[VER:1.1h]\r\nok\r\n"))
        timer.start()
        assert link.command("$I") == ["[VER:1.1h]"]
        timer.join()

    def test_a_port_is_held_alone_and_its_loss_is_told(self, port: tuple[GrblLink, int]) -> None:
        link, master = port
        with pytest.raises(UserError, match="no other program holds it"):
            GrblLink(link._port.port)
        os.close(master)
        with pytest.raises(RobotLostError, match="the serial port went away"):
            link.status()


class TestUr:
    @pytest.fixture
    def world(self) -> World:
        return World(GraySensor(), clock=Clock(SCALE))

    @pytest.fixture
    def arm(self, world: World) -> Iterator[UrEmulator]:
        with UrEmulator(world, HOST) as arm:
            yield arm

    @pytest.fixture
    def robot(self, arm: UrEmulator, make: Make) -> Iterator[UrRobot]:
        keys = {"address": arm.host, "time_scale": SCALE, "watchdog_hz": 2.0}
        robot = UrRobot(make(robot=keys))
        robot.connect()
        yield robot
        robot.close()

    def test_local_mode_is_refused(self, world: World, make: Make) -> None:
        with UrEmulator(world, HOST, remote=False) as arm:
            robot = UrRobot(make(robot={"address": arm.host}))
            with pytest.raises(UserError, match=r"local mode; switch it to remote control"):
                robot.connect()
            robot.close()

    def test_a_robot_that_is_not_there(self, make: Make) -> None:
        with pytest.raises(UserError, match=r"answers as a UR does.*robot\.address"):
            UrRobot(make(robot={"address": "127.0.0.98"})).connect()

    def test_the_dashboard_says_what_it_is(self, arm: UrEmulator) -> None:
        board = Dashboard(arm.host)
        board.check_ready()
        assert "5.12" in board.version
        board.close()

    @needs_rtde
    @pytest.mark.long
    def test_registers_of_a_fieldbus_are_refused(self, world: World, make: Make) -> None:
        with UrEmulator(world, HOST, in_use=("input_int_register_0",)) as arm:
            robot = UrRobot(make(robot={"address": arm.host, "time_scale": SCALE}))
            with pytest.raises(UserError, match=r"already in use.*fieldbus"):
                robot.connect()
            robot.close()

    @needs_rtde
    @pytest.mark.long
    def test_it_goes_where_it_is_sent_and_stops(self, robot: UrRobot, world: World) -> None:
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
        self, robot: UrRobot, world: World
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

    @needs_rtde
    @pytest.mark.long
    def test_a_stream_that_freezes_is_a_lost_arm(self, robot: UrRobot, world: World) -> None:
        world.arm(Fault("frozen-stream", value=SCALE * 60))
        with pytest.raises(RobotLostError, match="sends nothing any more"):
            _until(lambda: robot.state() is None)

    @pytest.mark.parametrize(
        ("bits", "mode", "words", "normal", "protective"),
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
        self, bits: int, mode: int, words: str, normal: bool, protective: bool
    ) -> None:
        assert describe_safety(bits, mode) == words
        assert is_normal(bits) == normal
        assert is_protective_stop(bits) == protective


def _until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.01)


class Dobot:
    """What a robot of the cri convention has."""

    def __init__(self) -> None:
        self.pose = (0.0,) * 6
        self.linear_speed = 0.0
        self.axes = "rxyz"

    def move_linear(self, pose: Pose6) -> None:
        if pose[0] > 100.0:
            raise ValueError("out of reach")
        self.pose = pose

    def close(self) -> None: ...


class TestCri:
    @pytest.fixture
    def make_robot(self, monkeypatch: pytest.MonkeyPatch, make: Make) -> Callable[[str], CriRobot]:
        module = ModuleType("dobot_of_the_lab")
        module.make = Dobot  # type: ignore[attr-defined]
        module.half = object  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)
        return lambda name: CriRobot(
            make(robot={"driver": "cri", "address": f"dobot_of_the_lab:{name}"})
        )

    def test_any_object_with_three_names(self, make_robot: Callable[[str], CriRobot]) -> None:
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

    @pytest.mark.parametrize(
        ("name", "words"), [("half", "without 'move_linear'"), ("no", "needs")]
    )
    def test_what_is_no_robot(
        self, make_robot: Callable[[str], CriRobot], name: str, words: str
    ) -> None:
        with pytest.raises(UserError, match=words):
            make_robot(name).connect()
