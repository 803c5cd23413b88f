"""The driver of a UR, with ur_rtde, against a scripted controller; that of any robot object."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from types import ModuleType

import pytest
from fake_station import finish, make_settings
from scripted_ur import STOP_L, ScriptedUr

from tactibench import Indenter, Pose, Scene, UserError
from tactibench_tactip import (
    CriRobot,
    Pose6,
    RobotError,
    RobotLostError,
    RobotThread,
    UrRobot,
    angle_between,
    check_setup,
    describe_place,
    from_ur,
    geometry_of,
    matrix,
    pose_of,
    safety_state,
    to_ur,
)

HOST = "127.0.0.97"
needs_rtde = pytest.mark.skipif(
    find_spec("rtde_control") is None, reason="ur_rtde is not installed (no wheel for Python 3.13)"
)


@pytest.fixture
def arm() -> Iterator[ScriptedUr]:
    with ScriptedUr(HOST) as arm:
        yield arm


@pytest.fixture
def robot(arm: ScriptedUr) -> Iterator[UrRobot]:
    robot = UrRobot(make_settings(robot={"address": arm.host, "watchdog_hz": 2.0}))
    robot.connect()
    yield robot
    robot.close()


@pytest.mark.parametrize(
    ("given", "change", "message"),
    [
        ({"remote": False}, {}, r"local mode; switch it to remote control"),
        ({}, {"safety": "ROBOT_EMERGENCY_STOP"}, "safety status is ROBOT_EMERGENCY_STOP"),
        ({}, {"mode": 3}, "robot mode POWER_OFF"),
    ],
)
def test_an_arm_that_is_not_ready_is_refused(
    given: dict[str, bool], change: dict[str, object], message: str
) -> None:
    with ScriptedUr(HOST, **given) as arm:
        for name, value in change.items():
            setattr(arm, name, value)
        robot = UrRobot(make_settings(robot={"address": arm.host}))
        with pytest.raises(UserError, match=message):
            robot.connect()
        robot.close()


def test_a_robot_that_is_not_there() -> None:
    with pytest.raises(UserError, match=r"answers as a UR does.*robot\.address"):
        UrRobot(make_settings(robot={"address": "127.0.0.98"})).connect()


@needs_rtde
@pytest.mark.long
def test_registers_of_a_fieldbus_are_refused() -> None:
    with ScriptedUr(HOST, in_use="input_int_register_0") as arm:
        robot = UrRobot(make_settings(robot={"address": arm.host}))
        with pytest.raises(UserError, match=r"already in use.*fieldbus"):
            robot.connect()
        robot.close()


@needs_rtde
@pytest.mark.long
def test_another_tcp_on_the_pendant_is_refused_before_it_is_replaced() -> None:
    with ScriptedUr(HOST, tcp_mm=50.0) as arm:
        robot = UrRobot(make_settings(robot={"address": arm.host}))
        with pytest.raises(UserError, match=r"TCP is 0\.0, -?0\.0, 50\.0.*robot\.set_tcp = true"):
            robot.connect()
        robot.close()
        assert arm.tcp[2] == 0.05
        robot = UrRobot(make_settings(robot={"address": arm.host, "set_tcp": True}))
        robot.connect()
        assert arm.tcp[2] == pytest.approx(0.0891)
        assert arm.watchdog_hz == 10.0
        assert robot.describe()["speed_slider"] == "100 %"
        robot.close()


@needs_rtde
@pytest.mark.long
def test_a_program_that_runs_is_read_and_never_ended(arm: ScriptedUr) -> None:
    """Neither the doctor nor a look at the pose stops it, and a move is refused."""
    arm.program, arm.runs, arm.slider = "PLAYING grip.urp", True, 0.3
    settings = make_settings(robot={"address": arm.host})
    rows = {part: (mark, text) for mark, part, text in check_setup(settings)}
    mark, text = rows["robot"]
    assert mark == "WRONG"
    assert "a program runs, PLAYING grip.urp, which a move would end" in text
    robot = UrRobot(settings)
    robot.connect("look")
    assert robot.pose() == pytest.approx(from_ur(arm.pose))
    told = robot.describe()
    assert told["payload"] == "1.20 kg, its centre of gravity at 0, -10, 45 mm"
    assert (told["program"], told["speed_slider"]) == ("PLAYING grip.urp", "30 %")
    assert robot.state().speed_share == pytest.approx(0.3)
    robot.close()
    for program in ("PLAYING grip.urp", "PAUSED grip.urp", "could not understand", "STOPPED"):
        arm.program = (
            program  # STOPPED: a script that somebody sent runs without the pendant's word
        )
        robot = UrRobot(settings)
        with pytest.raises(UserError, match=r"end it on the pendant|a program runs there"):
            robot.connect()
        robot.close()
    assert (arm.runs, arm.stopped, arm.scripts, arm.commands) == (True, 0, 0, [])
    assert arm.tcp[2] == pytest.approx(0.0891)


@needs_rtde
@pytest.mark.long
def test_an_old_controller_tells_no_payload() -> None:
    with ScriptedUr(HOST, lacks=("payload", "payload_cog")) as arm:
        robot = UrRobot(make_settings(robot={"address": arm.host}))
        robot.connect("look")
        assert robot.describe()["payload"] == "not told"
        assert not robot.state().stopped
        robot.close()


@needs_rtde
@pytest.mark.long
def test_what_ended_the_program_is_named_also_where_it_comes_later(
    robot: UrRobot, arm: ScriptedUr, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactibench_tactip.ur.NAMED_S", 5.0)  # on a busy machine, too
    arm.runs = False
    _until(lambda: not robot._link.facts()["program"])
    timer = threading.Timer(0.15, arm.stop_with, ("ROBOT_EMERGENCY_STOP",))
    timer.start()
    with pytest.raises(RobotError, match="emergency stop") as caught:
        robot.start(from_ur(arm.pose), 5.0, 500.0)
    assert "its control program ended" not in str(caught.value)
    timer.join()


@needs_rtde
@pytest.mark.long
def test_it_goes_where_it_is_sent_and_stops(robot: UrRobot, arm: ScriptedUr) -> None:
    # Ctrl-C does not reach its process; a session of its own would be starved by the kernel.
    process = robot._link._process.pid
    assert (os.getsid(process), os.getpgid(process)) == (os.getsid(0), process)
    start = robot.pose()
    target: Pose6 = (start[0] + 3.0, start[1], start[2] - 5.0, *start[3:])
    robot.start(target, 20.0, 500.0)
    # Not ``finish``: the word about a move that goes on may come a little after its beginning.
    _until(lambda: robot.pose()[:3] == pytest.approx(target[:3], abs=0.02))
    assert angle_between(robot.pose(), target) < 0.01
    state = robot.state()
    assert state.normal
    assert state.force_n == (0.0, 0.0, 0.0)
    robot.start(start, 0.5, 500.0)
    robot.stop()
    finish(robot)
    assert STOP_L in arm.commands
    robot.close()
    _until(lambda: not arm.runs)
    with pytest.raises(RobotLostError):
        robot.state()


@needs_rtde
@pytest.mark.long
def test_a_stop_and_an_ended_program_are_told(robot: UrRobot, arm: ScriptedUr) -> None:
    pose = from_ur(arm.pose)
    arm.stop_with("PROTECTIVE_STOP")
    _until(lambda: robot.state().stopped)
    with pytest.raises(RobotError, match=r"the UR refuses.*protective stop"):
        robot.start(pose, 5.0, 500.0)
    arm.safety = "NORMAL"
    _until(lambda: not robot.state().stopped)
    assert not robot.state().normal
    assert "its control program ended" in robot.state().description
    with pytest.raises(RobotError, match="control program") as caught:
        robot.start(pose, 5.0, 500.0)
    assert "safety limits" not in str(caught.value)


@needs_rtde
@pytest.mark.long
def test_a_stream_that_freezes_is_a_lost_arm(robot: UrRobot, arm: ScriptedUr) -> None:
    arm.frozen = True
    with pytest.raises(RobotLostError, match="sends nothing any more"):
        _until(lambda: robot.state() is None)


IN_CONTACT = "mm past first touch, in contact"
FAULTS: dict[str, tuple[Callable[[ScriptedUr], None], str, str]] = {
    "protective": (lambda arm: arm.stop_with("PROTECTIVE_STOP"), "protective stop", "The tool is"),
    "red button": (lambda arm: arm.stop_with("ROBOT_EMERGENCY_STOP"), "emergency", "The tool is"),
    "pendant": (lambda arm: setattr(arm, "runs", False), "control program ended", "The tool is"),
    "power": (lambda arm: setattr(arm, "mode", 3), "power off", "The tool is"),
    "frozen": (lambda arm: setattr(arm, "frozen", True), "sends nothing any more", "last seen"),
    "cable": (lambda arm: arm.hang_up(), "sends nothing any more", "last seen"),
}
"""What happens in contact -> what is said of it, and of the tool."""


@needs_rtde
@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_contact_is_named_and_the_tool_is_told_of(arm: ScriptedUr, fault: str) -> None:
    settings = make_settings(robot={"address": arm.host, "watchdog_hz": 2.0})
    geometry, scene = geometry_of(settings), Scene(Indenter.single(), Pose(depth=3.0))
    path, (make, message, told) = geometry.path(scene), FAULTS[fault]
    arm.pose = to_ur(pose_of(matrix(settings.frames.work_frame) @ matrix(path.above)))

    def guard(pose: Pose6) -> str:
        arm.turns = 300
        if pose[2] > 1.0:
            make(arm)
        return ""

    with RobotThread(UrRobot(settings), settings) as thread:
        with pytest.raises(RobotError, match=message):
            thread.do(lambda m: m.descend(path, guard))
        if told == "The tool is":
            with pytest.raises(RobotError, match=message):
                thread.do(lambda m: m.withdraw(scene, geometry))
        sentence = describe_place(thread, geometry, scene, 0.0)
    assert told in sentence
    assert IN_CONTACT in sentence


@pytest.mark.parametrize(
    ("bits", "mode", "message", "normal", "protective"),
    [
        (0b1, 7, "normal", True, False),
        (0b10, 7, "reduced", True, False),
        (0b100, 7, "protective stop", False, True),
        (0b1000000100, 7, "protective stop, safety fault", False, False),
        (0b11000000, 7, "emergency stop of the robot, emergency stop", False, False),
        (0b1, 3, "power off", False, False),
        (0b0, 7, "normal", False, False),
    ],
)
def test_safety_bits(bits: int, mode: int, message: str, normal: bool, protective: bool) -> None:
    state = safety_state(bits, mode)
    assert state.description == f"the UR says: {message}"
    assert (state.normal, state.stopped) == (normal, protective)


def _until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.01)


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
def make_robot(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], CriRobot]:
    module = ModuleType("dobot_of_the_lab")
    module.make = Dobot  # type: ignore[attr-defined]
    module.half = object  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return lambda name: CriRobot(
        make_settings(robot={"driver": "cri", "address": f"dobot_of_the_lab:{name}"})
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
