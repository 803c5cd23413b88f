"""The driver of a stage, with pyserial, against a scripted GRBL on a pseudo-terminal."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress

import pytest
from fake_station import finish, make_settings
from scripted_grbl import (
    FLUID_NC,
    GRBL,
    GRBL_09,
    GRBL_HAL,
    WORK_POSITIONS,
    Firmware,
    ScriptedGrbl,
)

from tactibench import Pose, Scene, UserError
from tactibench_tactip import (
    GrblLink,
    GrblRobot,
    NoAnswerError,
    Pose6,
    PositionUnknownError,
    Purpose,
    RobotError,
    RobotThread,
    Settings,
    StopNowError,
    check_setup,
    connect_seconds,
    describe_place,
    geometry_of,
)

Make = Callable[..., Settings]
UNHOMED = Firmware(settings={"$22": "0", "$20": "0"})

pytest.importorskip("serial", reason="pyserial is not installed: pip install tactibench[serial]")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.005)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stage is asked more often, as it goes so far at every report, and starts at once."""
    for name, seconds in (("POLL_S", 0.002), ("BANNER_S", 0.1)):
        monkeypatch.setattr(f"tactibench_tactip.grbl.{name}", seconds)
    monkeypatch.setattr("tactibench_tactip.motion.TICK_S", 0.001)


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
    # How far, not where; G91 last, so that no rest of the line is a move to a place.
    assert stage.lines[-1] == "$J=X-99.0000Y-94.0000Z-29.0000F3000.0G21G91"
    assert robot.pose() == pytest.approx(target, abs=0.01)
    assert robot.state().normal
    assert robot.describe()["$20"] == "1"
    with pytest.raises(RobotError, match="cannot turn"):
        robot.start((*target[:3], 180.0, 0.0, 30.0), 5.0, 500.0)
    with pytest.raises(RobotError, match="beyond the stage's travel"):
        robot.start((10.0, *target[1:]), 5.0, 500.0)
    robot.start((*target[:2], -60.0, *target[3:]), 5.0, 500.0)
    assert robot.moving()
    with pytest.raises(RobotError, match="not at rest, but in state Jog"):
        robot.start(target, 5.0, 500.0)
    robot.stop()
    finish(robot)
    assert -60.0 < robot.pose()[2] < -30.0
    assert stage.realtime == b"\x85"
    robot.close()


@pytest.mark.parametrize(
    ("firmware", "settings", "message"),
    [
        (GRBL, {}, r"position of the stage is not known: .* since it started.*hw jog --home"),
        (GRBL_HAL, {}, "position of the stage is not known"),
        (GRBL, {"$22": "0", "$20": "0"}, r"\$20=0; set \$20=1"),
        (GRBL, {"$22": "0"}, r"does not home \(\$22=0\)"),
        (GRBL_HAL, {"$22": "10"}, r"does not home \(\$22=10\)"),
        (GRBL, {"$13": "1"}, r"\$13=1; set \$13=0"),
        (GRBL, {"$112": "600"}, r"axis z of the stage reaches 10\.0 mm/s"),
        (FLUID_NC, {}, r"tell its setting \$13 \(reports in mm\).*lacks = \[\"\$13\"\]"),
    ],
)
def test_a_stage_that_is_not_ready_is_refused(
    keys: Make, firmware: Firmware, settings: dict[str, str], message: str
) -> None:
    with ScriptedGrbl(settings, firmware) as stage:
        robot = GrblRobot(keys(stage))
        with pytest.raises(UserError, match=message):
            robot.connect()
        robot.close()
        assert not stage.ways
        assert "$H" not in stage.lines


@pytest.mark.parametrize(
    ("firmware", "settings"),
    [
        (GRBL, {}),
        (GRBL, {"$22": "3"}),
        (GRBL_09, {}),
        (GRBL_HAL, {}),
        (FLUID_NC, {}),
        (WORK_POSITIONS, {}),
    ],
)
def test_firmwares_are_homed_whether_they_are_locked_or_not(
    keys: Make, firmware: Firmware, settings: dict[str, str]
) -> None:
    """A work position alone tells no place, as its offset comes in the tenth report."""
    with ScriptedGrbl(settings, firmware) as stage:
        robot = GrblRobot(keys(stage, home=True, lacks=firmware.lacks))
        robot.connect()
        assert stage.lines.count("$H") == 1
        robot.start((-100.0, -95.0, -30.0, 180.0, 0.0, 0.0), 50.0, 500.0)
        finish(robot)
        assert stage.tool == pytest.approx((-100.0, -95.0, -30.0), abs=0.01)
        robot.close()


def test_a_position_is_known_until_the_controller_starts_anew(
    stage: ScriptedGrbl, keys: Make
) -> None:
    def connect(purpose: Purpose, **robot: bool) -> int:
        driver = GrblRobot(keys(stage, **robot))
        try:
            driver.connect(purpose)
        finally:
            driver.close()
        return stage.lines.count("$H")

    assert connect("home") == 1
    assert connect("move") == 1
    assert connect("move", home=True) == 1
    assert connect("home") == 2  # --home homes always
    stage.start_anew()
    stage.state = "Idle"  # somebody unlocked it
    assert connect("look", home=True) == 2
    with pytest.raises(PositionUnknownError):
        connect("move")
    assert connect("move", home=True) == 3


def test_where_there_are_no_switches_a_person_says_that_the_position_is_right(keys: Make) -> None:
    with ScriptedGrbl({"$22": "0", "$20": "0"}) as stage:
        for purpose, known in (("move", False), ("home", True), ("move", True)):
            robot = GrblRobot(keys(stage, allow_unhomed=True))
            with nullcontext() if known else pytest.raises(PositionUnknownError):
                robot.connect(purpose)
            robot.close()
        assert "$H" not in stage.lines
        assert not stage.ways


def test_doctor_takes_a_stage_that_homes_before_it_moves(stage: ScriptedGrbl, keys: Make) -> None:
    """Opening the port resets it: it is never homed when it is looked at."""
    for home, marks, text in (
        (True, ["ok", "ok"], "not yet"),
        (False, ["ok", "WRONG"], "jog --home"),
    ):
        rows = [*check_setup(keys(stage, home=home))][1:]  # there is no camera
        assert [mark for mark, _, _ in rows] == marks
        assert text in rows[-1][2]
    assert not [line for line in stage.lines if line == "$H" or line.startswith("$J")]
    assert not stage.realtime


def test_what_is_no_grbl_is_refused() -> None:
    with pytest.raises(UserError, match="cannot be opened"):
        GrblRobot(
            make_settings(robot={"driver": "grbl", "address": "socket://127.0.0.1:1"})
        ).connect()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("ALARM:1", "alarm 1: a limit switch was hit"),
        ("ALARM:2", "alarm 2: a target beyond"),
        ("ALARM:3", "alarm 3: it was reset while it moved"),
        ("Grbl 1.1h ['$' for help]", "its controller was reset"),
        ("GrblHAL 1.1f ['$' or '$HELP' for help]", "its controller was reset"),
    ],
)
def test_after_an_alarm_or_a_reset_nothing_moves(
    stage: ScriptedGrbl, keys: Make, line: str, message: str
) -> None:
    robot = GrblRobot(keys(stage, home=True))
    robot.connect()
    stage.say(line)
    told = f"not known: {message}.*jog --home"
    with pytest.raises(PositionUnknownError, match=told):
        robot.start((-100.0, -100.0, -50.0, 180.0, 0.0, 0.0), 5.0, 500.0)
    for ask in (robot.pose, robot.state):
        with pytest.raises(PositionUnknownError, match=told):
            ask()
    assert not stage.ways
    robot.close()
    until(lambda: stage.realtime == b"\x85!\x18")  # which erases the mark
    with pytest.raises(PositionUnknownError):
        GrblRobot(keys(stage)).connect()


@pytest.mark.parametrize(
    ("banner", "message"),
    [("\xffGrbl 1.1h ['$' for help]", "was reset"), ("Gr\xff", "not told where it is")],
)
def test_a_reset_whose_line_is_damaged_is_noticed(keys: Make, banner: str, message: str) -> None:
    """A stage without switches does not lock itself, and is at zero then."""
    with ScriptedGrbl(firmware=UNHOMED) as stage:
        robot = GrblRobot(keys(stage, allow_unhomed=True))
        robot.connect("home")
        assert robot.pose()[:3] == stage.tool
        stage.start_anew(banner)
        with pytest.raises(PositionUnknownError, match=message):
            robot.start((-50.0, -50.0, -60.0, 180.0, 0.0, 0.0), 5.0, 500.0)
        assert not stage.ways
        robot.close()


@pytest.mark.parametrize(
    "begun", [b"G1X-5F100", b"G0Z-9", b"$J=X5F100G91", b"$H", b"$X", b"$$", b"?", b"(a person"]
)
@pytest.mark.parametrize("state", ["Alarm", "Idle"])
def test_a_line_that_another_program_began_is_never_run(
    keys: Make, begun: bytes, state: str
) -> None:
    """An empty line, as senders begin with, would end that line and run it."""
    with ScriptedGrbl(state=state) as stage:
        stage.begun = begun
        robot = GrblRobot(keys(stage))
        robot.connect("look")
        robot.close()
        assert stage.lines[0] == (begun + b"$").decode()
        assert (stage.ways, stage.state) == ([], state)
        assert "$H" not in stage.lines


def test_a_place_that_was_damaged_once_is_asked_for_again(stage: ScriptedGrbl, keys: Make) -> None:
    """A digit that is lost on the line does not end a session; another place that stays does."""
    robot = GrblRobot(keys(stage, home=True))
    robot.connect()
    place = robot.pose()
    for damaged in ("<Idle|MPos:-1.000,-1.000,-0.000|FS:0,0>", "<Idle|MPos:-1.000,-1"):
        stage.say(damaged)
        assert robot.pose() == place
    target: Pose6 = (-50.0, -50.0, -50.0, 180.0, 0.0, 0.0)
    robot.start(target, 50.0, 500.0)
    while stage.state != "Idle":
        robot.moving()
    stage.say("<Idle|MPos:-50.000,-50.000,-0.000|FS:0,0>")
    assert robot.pose() == pytest.approx(target, abs=0.01)
    stage.tool = (-50.0, -50.0, -49.0)
    with pytest.raises(PositionUnknownError, match="another place than before"):
        robot.start(target, 5.0, 500.0)
    assert len(stage.ways) == 1
    robot.close()


@pytest.mark.parametrize(
    "state", ["Hold:0", "Run", "Home", "Check", "Door:0", "Sleep", "Tool", "?"]
)
def test_a_state_that_is_not_rest_is_not_normal(
    stage: ScriptedGrbl, keys: Make, state: str
) -> None:
    robot = GrblRobot(keys(stage, home=True))
    robot.connect()
    robot._polled_at = time.monotonic() + 9.0  # a stage that homes answers no question
    stage.say(f"<{state}|MPos:-1.000,-1.000,-1.000|FS:0,0>")
    until(lambda: not robot.state().normal)
    assert "somebody paused it, or something else runs" in robot.state().description
    robot.close()


CLEARANCE, TOUCH, DEPTH = -60.0, -70.0, 3.0
"""Heights of the stage, mm, at clearance and at first touch; depth of the presses."""


def press_twice(settings: Settings) -> None:
    """Press at two places, as a session does."""
    geometry = geometry_of(settings)
    with RobotThread(GrblRobot(settings), settings) as thread:
        if thread.robot.at_switches:
            thread.do(lambda m: m.come_in(20.0))
        thread.do(lambda m: m.raise_straight(geometry))
        for x in (0.0, 3.0):
            scene = Scene(settings.indenter.indenter(), Pose(x, 0.0, depth=DEPTH))
            path = geometry.path(scene)
            try:
                thread.do(lambda m, path=path: m.descend(path, m.force_guard()))
            finally:
                thread.do(lambda m, scene=scene: m.withdraw(scene, geometry))


def deepest_unsafe(stage: ScriptedGrbl) -> float:
    """Return how deep the tool came; fail where it was moved sideways below clearance."""
    for start, end in stage.ways:
        sideways = max(abs(a - b) for a, b in zip(start[:2], end[:2], strict=True))
        low = min(start[2], end[2])
        assert sideways < 0.01 or low > CLEARANCE - 0.2, f"sideways at z {low}"
    return TOUCH - min(end[2] for _, end in stage.ways) if stage.ways else 0.0


@pytest.mark.parametrize(
    ("firmware", "first", "stride"),
    [
        (UNHOMED, 301, 677),
        *(
            pytest.param(firmware, 5, 31, marks=pytest.mark.long)
            for firmware in (GRBL, GRBL_HAL, FLUID_NC, UNHOMED)
        ),
    ],
)
def test_a_reset_at_any_byte_of_a_session(
    keys: Make, firmware: Firmware, first: int, stride: int
) -> None:
    """The tool never moves sideways in contact, nor deeper, in this session nor in the next."""
    at, ended = first, False
    while not ended:
        with ScriptedGrbl(firmware=firmware) as stage:
            known = {"home": firmware is not UNHOMED, "lacks": firmware.lacks}
            settings = keys(stage, allow_unhomed=True, **known)
            stage.tool = (-100.0, -100.0, -40.0)
            if firmware is UNHOMED:
                robot = GrblRobot(settings)
                robot.connect("home")
                robot.close()
                stage._received = 0
            stage.reset_at = at
            failures: list[str] = []
            try:
                press_twice(settings)
            except UserError as error:
                failures.append(str(error))
            told = "position of the stage is not known"
            assert all(told in failure for failure in failures), (at, failures)
            ended = stage._received < at
            stage.reset_at = 0
            if not ended and firmware is UNHOMED:
                count = len(stage.ways)
                with pytest.raises(PositionUnknownError):
                    press_twice(settings)
                assert len(stage.ways) == count
            assert deepest_unsafe(stage) < DEPTH + 0.5, at
        at += stride


def test_a_port_that_returns_half_lines(keys: Make) -> None:
    """Whatever the pieces, the session makes the same moves."""
    ways = []
    for piece in (0, 1, 3):
        with ScriptedGrbl() as stage:
            stage.piece, stage.tool = piece, (-100.0, -100.0, -40.0)
            press_twice(keys(stage, home=True))
            ways.append(stage.ways)
    assert ways[0] == ways[1] == ways[2]


@pytest.mark.parametrize("says", ["ALARM:1", "ALARM:\xff", ""])
def test_an_alarm_in_the_middle_of_a_retreat(stage: ScriptedGrbl, keys: Make, says: str) -> None:
    """Nothing moves any more; the sentence tells where the tool was last seen."""
    settings = keys(stage, home=True)
    geometry, scene = geometry_of(settings), Scene(settings.indenter.indenter(), Pose(depth=DEPTH))

    def alarm() -> None:
        stage.state = "Alarm"
        if says:
            stage.say(says)

    with RobotThread(GrblRobot(settings), settings) as thread:
        thread.do(lambda m: m.come_in(20.0))
        thread.do(lambda m: m.descend(geometry.path(scene), m.force_guard()))
        count, stage.at_way = len(stage.ways), alarm
        with pytest.raises(PositionUnknownError, match="alarm"):
            thread.do(lambda m: m.withdraw(scene, geometry))
        for _ in range(2):
            with pytest.raises(PositionUnknownError):
                thread.do(lambda m: m.withdraw(scene, geometry))
        told = describe_place(thread, geometry, scene, 0.0)
    assert len(stage.ways) == count + 1
    assert "the tool was last seen at" in told
    assert "in contact" in told
    with pytest.raises(PositionUnknownError):
        GrblRobot(keys(stage)).connect()


@pytest.mark.parametrize("line", range(3, 9))
def test_a_mute_controller_goes_on_half_a_millimetre_at_most(
    stage: ScriptedGrbl, keys: Make, monkeypatch: pytest.MonkeyPatch, line: int
) -> None:
    """Its last move in contact is short, as nothing tells it that nobody listens."""
    settings = keys(stage, home=True)
    geometry = geometry_of(settings)
    path = geometry.path(Scene(settings.indenter.indenter(), Pose(depth=DEPTH)))
    seen: list[float] = []

    def guard(pose: Pose6) -> str:
        if pose[2] > -1.0 + 0.5 * (line - 3) and not seen:
            seen.append(pose[2])
            stage.mute = True
            for method in (GrblLink.status, GrblLink.command, GrblLink.read_modes):
                monkeypatch.setattr(method, "__defaults__", (0.1,))  # nobody waits for a mute one
        return ""

    with RobotThread(GrblRobot(settings), settings) as thread:
        thread.do(lambda m: m.come_in(20.0))
        with pytest.raises(RobotError):
            thread.do(lambda m: m.descend(path, guard))
    assert TOUCH - min(end[2] for _, end in stage.ways) < seen[0] + 0.5


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
    until(lambda: stage.realtime == b"\x85!\x18")  # the reset ends homing


def test_closing_never_raises(
    stage: ScriptedGrbl, keys: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another thread may have closed the port meanwhile."""
    robot = GrblRobot(keys(stage, home=True))
    robot.connect()
    link = robot._link
    monkeypatch.setattr(link._port, "fd", None)
    with pytest.raises(RobotError):
        link.send(b"!")
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
        ("<Idle|FS:0,0>", "Idle", None),
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
    before = link.parse_status("<Idle|WPos:0,0,0>")
    assert before is not None
    assert before.position is None  # the offset is not known yet
    link.parse_status("<Idle|WPos:0,0,0|WCO:1.0,2.0,3.0>")  # it is remembered
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
            link.command("$J=X1", 5.0 if answer else 0.1)
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
    monkeypatch.setattr(GrblLink.read_modes, "__defaults__", (0.1,))
    with pytest.raises(NoAnswerError):
        link.command("$$", 0.1)
    with pytest.raises(NoAnswerError, match="too late or not at all"):
        link.command("$$", 0.1)
