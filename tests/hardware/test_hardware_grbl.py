"""The driver of a stage, with pyserial, against a scripted GRBL on a pseudo-terminal."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest
from fake_station import finish, make_settings
from scripted_grbl import ScriptedGrbl

from tactibench import UserError
from tactibench_tactip import (
    GrblLink,
    GrblRobot,
    NoAnswerError,
    Pose6,
    RobotError,
    RobotLostError,
    RobotThread,
    Settings,
    StopNowError,
    check_setup,
    connect_seconds,
)

Make = Callable[..., Settings]

pytest.importorskip("serial", reason="pyserial is not installed: pip install tactibench[serial]")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


@pytest.fixture
def stage() -> Iterator[ScriptedGrbl]:
    with ScriptedGrbl() as stage:
        yield stage


@pytest.fixture
def keys() -> Make:
    def settings(stage: ScriptedGrbl, **robot: object) -> Settings:
        return make_settings(
            robot={"driver": "grbl", "address": stage.address, **robot},
            frames={"work_frame": [-100.0, -100.0, -70.0, 180.0, 0.0, 0.0], "tcp_pose": [0.0] * 6},
        )

    return settings


def test_homed_it_goes_where_it_is_sent(stage: ScriptedGrbl, keys: Make) -> None:
    robot = GrblRobot(keys(stage, home=True))
    robot.connect()
    assert robot.at_switches
    target: Pose6 = (-100.0, -95.0, -30.0, 180.0, 0.0, 0.0)
    robot.start(target, 50.0, 500.0)
    finish(robot)
    assert stage.lines[-1] == "$J=G53G90G21X-100.0000Y-95.0000Z-30.0000F3000.0"
    assert robot.pose() == pytest.approx(target, abs=0.01)
    assert robot.state().normal
    assert robot.describe()["$20"] == "1"
    with pytest.raises(RobotError, match="cannot turn"):
        robot.start((*target[:3], 180.0, 0.0, 30.0), 5.0, 500.0)
    with pytest.raises(RobotError, match="beyond the stage's travel"):
        robot.start((10.0, *target[1:]), 5.0, 500.0)
    robot.start((*target[:2], -60.0, *target[3:]), 5.0, 500.0)
    assert robot.moving()
    robot.stop()
    finish(robot)
    assert -60.0 < robot.pose()[2] < -30.0
    assert stage.realtime == b"\x85"
    robot.close()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, r"not homed.*robot.home = true"),
        ({"$22": 0, "$20": 0}, r"\$20=0; set \$20=1"),
        ({"$22": 0}, r"does not home"),
        ({"$13": 1}, r"\$13=1; set \$13=0"),
        ({"$112": 600}, r"axis z of the stage reaches 10\.0 mm/s"),
    ],
)
def test_a_stage_that_is_not_ready_is_refused(
    keys: Make, settings: dict[str, float], message: str
) -> None:
    with ScriptedGrbl(settings) as stage:
        robot = GrblRobot(keys(stage))
        with pytest.raises(UserError, match=message):
            robot.connect()
        robot.close()


def test_doctor_takes_a_stage_that_homes_before_it_moves(stage: ScriptedGrbl, keys: Make) -> None:
    """Opening the port resets it: it is never homed when it is looked at."""
    for home, marks, text in ((True, ["ok", "ok"], "not yet"), (False, ["WRONG"], "not homed")):
        rows = [*check_setup(keys(stage, home=home))][1:]  # there is no camera
        assert [mark for mark, _, _ in rows] == marks
        assert text in rows[-1][2]
    assert not [line for line in stage.lines if line == "$H" or line.startswith("$J")]


def test_what_is_no_grbl_is_refused() -> None:
    with pytest.raises(UserError, match="cannot be opened"):
        GrblRobot(
            make_settings(robot={"driver": "grbl", "address": "socket://127.0.0.1:1"})
        ).connect()


@pytest.mark.parametrize(
    ("line", "state", "message"),
    [
        ("ALARM:1", "Alarm", "a limit switch was hit"),
        ("ALARM:2", "Alarm", "position is kept"),
        ("ALARM:3", "Alarm", "reset while it moved"),
        ("[MSG:Pgm End]", "Hold:0", "somebody at the stage paused it"),
    ],
)
def test_what_stops_it_is_said(
    stage: ScriptedGrbl, keys: Make, line: str, state: str, message: str
) -> None:
    robot = GrblRobot(keys(stage, home=True))
    robot.connect()
    stage.state = state
    stage.say(line)
    robot.pose()  # a new report, which comes after the line
    assert not robot.state().normal
    assert message in robot.state().description
    robot.close()


def test_homing_may_take_longer_than_connecting(keys: Make) -> None:
    with ScriptedGrbl() as stage:
        settings = keys(stage, home=True, connect_s=0.01)
        assert connect_seconds(settings) > 60.0
        robot = GrblRobot(settings)
        with RobotThread(robot, settings):
            assert robot.at_switches


def test_homing_ends_when_somebody_asks_to_stop(stage: ScriptedGrbl, keys: Make) -> None:
    settings = keys(stage, home=True)
    stage.homes = False
    thread = RobotThread(GrblRobot(settings), settings)

    def halt() -> None:
        while "$H" not in stage.lines:
            time.sleep(0.002)
        thread.halt.set()

    helper = threading.Thread(target=halt)
    helper.start()
    with pytest.raises((StopNowError, RobotError)), thread:
        pytest.fail("it was connected")
    helper.join(5.0)
    end = time.monotonic() + 5.0
    while stage.realtime != b"!\x18":  # the reset ends homing
        assert time.monotonic() < end, "it was not reset"
        time.sleep(0.01)


def test_closing_never_raises(
    stage: ScriptedGrbl, keys: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another thread may have closed the port meanwhile."""
    robot = GrblRobot(keys(stage, home=True))
    robot.connect()
    link = robot._link
    monkeypatch.setattr(link._port, "fd", None)
    with pytest.raises(RobotError):
        link.realtime(b"!")
    robot.close()


@pytest.fixture
def port() -> Iterator[tuple[GrblLink, int]]:
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
    port: tuple[GrblLink, int],
    line: str,
    state: str | None,
    position: tuple[float, float, float] | None,
) -> None:
    link, _ = port
    link.parse_status("<Idle|WPos:0,0,0|WCO:1.0,2.0,3.0>")  # the offset is remembered
    status = link.parse_status(line)
    assert (status and status.state, status and status.position) == (state, position)


@pytest.mark.parametrize(("line", "number"), [(b"ALARM:1\r\n", 1), (b"ALARM:\xff\r\n", -1)])
def test_an_alarm_ends_a_move(port: tuple[GrblLink, int], line: bytes, number: int) -> None:
    """No report follows a critical one, and the last report said that it moves."""
    link, master = port
    os.write(master, b"<Jog|MPos:1,2,3>\r\n" + line)
    end = time.monotonic() + 2.0
    while not link.alarm and time.monotonic() < end:
        link.drain()
    assert (link.alarm, link.last.state) == (number, "Alarm")


def test_answers_refusals_and_silence(port: tuple[GrblLink, int]) -> None:
    link, master = port
    os.write(master, b"Grbl 1.1h ['$' for help]\r\n")
    link.wait_banner(2.0)
    assert link.banner.startswith("Grbl 1.1h")
    timer = threading.Timer(0.05, os.write, (master, b"[VER:1.1h]\r\nok\r\n"))
    timer.start()
    assert link.command("$I") == ["[VER:1.1h]"]
    timer.join()
    for answer, message in (
        (b"error:15\r\n", "beyond the stage's travel"),
        (b"error:\xff\r\n", "damaged"),
        (b"", "did not answer"),
    ):
        timer = threading.Timer(0.05, os.write, (master, answer))
        timer.start()
        with pytest.raises(RobotError, match=message):
            link.command("$J=X1", 0.2)
        timer.join()


def answer_as_grbl(master: int, late_s: float, answered: int) -> None:
    """Answer so many lines: the first late, ``$G`` and ``$$`` as GRBL does."""
    told = {b"$G": b"[GC:G1 G21 G90]\r\n", b"$$": b"$13=0\r\n"}
    text = b""
    for number in range(answered):
        while b"\n" not in text:
            text += os.read(master, 100)
        line, _, text = text.partition(b"\n")
        time.sleep(0.0 if number else late_s)
        os.write(master, told.get(line, b"") + b"ok\r\n")


@pytest.mark.parametrize("line", ["", "$I"])
def test_a_late_answer_is_not_taken_for_that_of_the_next_line(
    port: tuple[GrblLink, int], line: str
) -> None:
    link, master = port
    stage = threading.Thread(target=answer_as_grbl, args=(master, 0.3, 3))
    stage.start()
    with pytest.raises(NoAnswerError):
        link.command(line, 0.1)
    assert link.command("$$") == ["$13=0"]
    stage.join()


def test_answers_that_stay_away_are_a_lost_stage(
    port: tuple[GrblLink, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    link, _ = port
    monkeypatch.setattr("tactibench_tactip.grbl.ANSWER_S", 0.1)
    with pytest.raises(NoAnswerError):
        link.command("$$", 0.1)
    with pytest.raises(RobotLostError, match="too late or not at all"):
        link.command("$$", 0.1)
