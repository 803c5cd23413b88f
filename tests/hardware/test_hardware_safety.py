"""Guards, stops and limits: whatever happens, the tool is drawn back or left and told of."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fake_station import (
    FIXED_TOUCH,
    TRUE_Z0,
    FakeCapture,
    FakeRobot,
    Looking,
    make_settings,
    stand_in,
)

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import open_dataset
from tactibench.lab import Press
from tactibench_tactip import (
    Callbacks,
    Camera,
    CameraError,
    CollectionPlan,
    GuardError,
    Mover,
    Pose6,
    ProtectiveStopError,
    RobotError,
    RobotThread,
    Settings,
    Station,
    StopNowError,
    collect,
    describe_place,
    dry_run,
    geometry_of,
    inverse,
    matrix,
    measure_place,
    measure_settling,
    pose_of,
)

MAIN = threading.main_thread().ident or 0
SCENE = Scene(Indenter.single(), Pose(depth=2.0))
PLAN = CollectionPlan("test", (Press(0, "p", SCENE),), {"all": {"train": [0]}})


@pytest.fixture
def settings() -> Settings:
    return make_settings(contact=FIXED_TOUCH)


@pytest.fixture
def robot(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Looking:
    """The robot of every station that is made, with a camera beside it."""
    robot = Looking(settings)
    stand_in(lambda _: robot, monkeypatch)
    return robot


def test_a_held_press_ends_when_the_arm_stops(settings: Settings, robot: Looking) -> None:
    """Whoever looks at the camera alone would look for 30 s at an arm that stands still."""
    begin = time.monotonic()
    station = Station(settings)
    down = station.down

    def stopped(mover: Mover, path: Any) -> Any:
        moment = down(mover, path)
        robot.normal, robot.stopped = False, True
        return moment

    station.down = stopped  # type: ignore[method-assign]
    with pytest.raises(ProtectiveStopError, match="not normal"), station:
        measure_settling(station, 2.0, 30.0)
    assert time.monotonic() - begin < 10.0


def test_force_ends_a_dry_run(settings: Settings, robot: Looking) -> None:
    """Somebody left a hand where the tool goes."""
    robot.fails = lambda n: setattr(robot, "force", (0.0, 0.0, 30.0 if n > 2 else 0.0))
    robot.fails(0)
    with pytest.raises(GuardError, match="max_force_n") as caught:
        dry_run(settings, PLAN.presses, 20.0, Callbacks())
    assert "before first touch, clear of the sensor" in caught.value.__notes__[0]


def test_sigterm_before_the_first_press_ends_a_collection_at_once(
    settings: Settings, robot: Looking, tmp_path: Path
) -> None:
    """There is no traceback, and no split."""
    x, y, z, *turn = robot.at
    robot.at = (x, y, z - 35.0, *turn)  # type: ignore[assignment]
    assert robot.tool()[2] > -10.0  # it stands low, so that entering moves it

    def sent(_: int) -> None:
        robot.ticks = 10**9  # it does not arrive
        signal.pthread_kill(MAIN, signal.SIGTERM)

    robot.fails = sent
    report = collect(settings, PLAN, tmp_path / "data", callbacks=Callbacks())
    assert (report.interrupted, report.left) == (True, 1)
    dataset = open_dataset(tmp_path / "data")
    assert dataset.header.status == "open"
    assert not dataset.splits
    assert robot.closed


def test_a_second_interrupt_ends_a_press(
    settings: Settings, robot: Looking, tmp_path: Path
) -> None:
    def interrupt(_: int) -> None:
        if robot.tool()[2] > -5.0 and not deep:
            deep.append(1)
            robot.ticks = 10**9  # it does not arrive
            signal.pthread_kill(MAIN, signal.SIGINT)

    def again(text: str) -> None:
        if "again" in text:
            signal.raise_signal(signal.SIGINT)

    deep: list[int] = []
    robot.fails = interrupt
    report = collect(settings, PLAN, tmp_path / "data", callbacks=Callbacks(notify=again))
    assert (report.interrupted, report.left) == (True, 1)
    assert robot.tool()[2] <= TRUE_Z0 - settings.envelope.clearance_mm + 0.1


def test_an_error_is_told_where_the_way_back_was_stopped(
    settings: Settings, robot: Looking, tmp_path: Path
) -> None:
    def held() -> None:
        raise RobotError("somebody held it")

    def stopped() -> None:
        robot.ticks = 10**9
        signal.pthread_kill(MAIN, signal.SIGTERM)

    ways = iter((held, stopped))
    robot.fails = lambda _: next(ways, int)() if robot.depth() else None
    told: list[str] = []
    report = collect(settings, PLAN, tmp_path / "data", callbacks=Callbacks(notify=told.append))
    assert (report.interrupted, report.left) == (True, 1)
    assert told[:2] == ["stopping the robot", "somebody held it"]
    assert "10.00 mm before first touch, clear of the sensor" in told[2]
    (error,) = (e for e in open_dataset(tmp_path / "data").events if e["kind"] == "error")
    assert error["reason"] == "somebody held it"


def test_a_request_to_stop_between_a_failed_press_and_the_way_back_is_not_forgotten(
    settings: Settings, robot: Looking, camera: Camera, press_of: Callable[..., Scene]
) -> None:
    """The way back clears it, as it must not stop the way back."""

    def held(_: int) -> None:
        if robot.depth() and not pressed:
            pressed.append(1)
            station.stop_now()
            raise GuardError("the force changed")

    pressed: list[int] = []
    robot.fails = held
    with camera, Station(settings, robot, camera) as station:
        with pytest.raises(StopNowError) as caught:
            station.press(press_of())
        assert "the force changed" in str(caught.value.__context__)
        moves = len(robot.moves)
        with pytest.raises(StopNowError):
            station.press(press_of())
    assert len(robot.moves) == moves
    assert not robot.depth()
    assert "clear of the sensor" in station.place


def test_a_tool_that_was_left_at_a_press_is_drawn_back_before_it_moves_sideways(
    settings: Settings, robot: Looking, camera: Camera, press_of: Callable[..., Scene]
) -> None:
    lowest: list[float] = []  # of every sideways move

    def hold(_: int) -> None:
        if robot.depth() and next(holds, False):
            raise RobotError("somebody held it")
        start, (x, y, z, *_turn) = (
            robot.tool(),
            pose_of(inverse(robot.work) @ matrix(robot.moves[-1])),
        )
        if max(abs(x - start[0]), abs(y - start[1])) > 0.01:
            lowest.append(max(z, start[2]))

    holds = iter((True, True))  # the end of the press, and the way back after the error
    robot.fails = hold
    with camera, Station(settings, robot, camera) as station:
        with pytest.raises(RobotError, match="held it"):
            station.press(press_of())
        station.robot_thread.halt.set()
        with pytest.raises(StopNowError):
            station.press(press_of(3.0))
        assert robot.depth()  # a request to stop counts also here
        station.robot_thread.halt.clear()
        station.press(press_of(3.0))
    assert lowest
    assert max(lowest) <= TRUE_Z0 - settings.envelope.clearance_mm + 0.1


def test_a_camera_that_stalls_ends_a_descent(
    robot: Looking, press_of: Callable[..., Scene]
) -> None:
    def stall(_: int) -> None:
        if robot.tool()[2] > -5.0 and not capture.stalled.is_set():
            capture.stalled.set()
            robot.ticks = 10**9

    robot.capture = capture = FakeCapture(robot)
    settings = make_settings(contact=FIXED_TOUCH, camera={"stall_s": 0.3})
    with Station(settings) as station:
        station.look_at_rest()
        robot.fails = stall
        with pytest.raises(CameraError, match=r"gave no frame for 0\.3 s"):
            station.press(press_of())
        capture.stalled.clear()
    assert robot.tool()[2] <= TRUE_Z0 - settings.envelope.clearance_mm + 0.1


def test_a_tool_that_moves_is_stopped_before_it_is_drawn_back(
    settings: Settings, robot: Looking, camera: Camera
) -> None:
    with camera, Station(settings, robot, camera) as station:
        stops = robot.stops
        station.withdraw()
        assert robot.stops == stops + 1


TICKS = 150


class SlowRobot(FakeRobot):
    """Its first move into the skin lasts TICKS turns of the control loop. begun: told of it."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.log: list[str] = []
        self.left = 0
        self.begun: Callable[[], None] = lambda: None

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        super().start(pose, speed, acceleration)
        self.log.append("start")
        if self.tool()[2] > 0.5 and "slow" not in self.log:
            self.log.append("slow")
            self.busy, self.left = True, TICKS
            self.begun()

    def moving(self) -> bool:
        if self.busy:
            self.left -= 1
            if self.left == 0:
                self.busy = False
                self.log.append("finished")
        return self.busy

    def stop(self) -> None:
        super().stop()
        self.log.append("stop")


@pytest.fixture
def slow(settings: Settings) -> SlowRobot:
    return SlowRobot(settings)


def withdrawn_after_a_stop(robot: SlowRobot) -> bool:
    after = robot.log[robot.log.index("slow") + 1 :]
    clear = TRUE_Z0 - robot.settings.envelope.clearance_mm
    return after[0] == "stop" and after[-1] == "start" and robot.tool()[2] < clear + 0.1


def test_a_descent_that_takes_too_long_is_stopped_before_it_is_drawn_back(
    settings: Settings,
    slow: SlowRobot,
    camera: Camera,
    press_of: Callable[..., Scene],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with camera, Station(settings, slow, camera) as station:
        station.look_at_rest()
        monkeypatch.setattr("tactibench_tactip.motion.patience", lambda *_: 0.05)
        with pytest.raises(RobotError, match="took longer than"):
            station.press(press_of())
        assert withdrawn_after_a_stop(slow)
        assert not station.robot_thread.halt.is_set()


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_stops_a_descent(
    settings: Settings, slow: SlowRobot, camera: Camera, press_of: Callable[..., Scene]
) -> None:
    """Also where nobody installed handlers of signals."""
    main = threading.get_ident()
    with camera, Station(settings, slow, camera) as station:
        station.look_at_rest()
        slow.begun = lambda: signal.pthread_kill(main, signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            station.press(press_of())
        assert withdrawn_after_a_stop(slow)


def test_a_job_that_nobody_waits_for_is_never_begun(
    slow: SlowRobot, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactibench_tactip.motion.QUIET_S", 0.02)
    held = threading.Event()
    begun: list[str] = []

    def hold(_: Mover) -> None:
        held.wait(5.0)

    with RobotThread(slow, settings) as owner:
        for job in (hold, lambda _: begun.append("late")):
            with pytest.raises(RobotError, match="told to stop"):
                owner.do(job)
        held.set()
    assert begun == []


@pytest.mark.parametrize(
    ("place", "slack", "told"),
    [
        (
            (0.0, 0.0, 2.0),
            0.1,
            "z 2.00 mm of the work frame, 2.00 mm past first touch, in contact.",
        ),
        ((0.0, 0.0, -2.0), 0.1, "2.00 mm before first touch, clear of the sensor."),
        ((0.0, 0.0, -2.0), 3.0, "2.00 mm before first touch, perhaps in contact."),
        (
            (50.0, 0.0, -2.0),
            3.0,
            "x 50.00, y 0.00, z -2.00 mm of the work frame, beside the sensor.",
        ),
    ],
)
def test_the_place_of_the_tool_is_told(
    settings: Settings,
    robot: Looking,
    press_of: Callable[..., Scene],
    place: tuple[float, float, float],
    slack: float,
    told: str,
) -> None:
    robot.at = pose_of(robot.work @ matrix((*place, 0.0, 0.0, 0.0)))
    geometry = geometry_of(settings).with_z0(0.0)
    with RobotThread(robot, settings) as thread:
        assert told in describe_place(thread, geometry, press_of(), slack)
        assert describe_place(thread, geometry, press_of(), slack).startswith("The tool is at")

        def lost() -> Pose6:
            raise RobotError("the cable")

        robot.pose = lost  # type: ignore[method-assign]
        sentence = describe_place(thread, geometry, press_of(), slack)
    assert "the tool was last seen at" in sentence
    assert "clear of" not in sentence


class TestLeftInTheSkin:
    @pytest.fixture
    def robot(self, settings: Settings) -> FakeRobot:
        """Stopped in the skin for good."""
        robot = FakeRobot(settings)

        def stop(_: int) -> None:
            if robot.tool()[2] > -5.0:
                robot.normal, robot.stopped = False, True

        robot.fails = stop
        return robot

    def test_an_error_says_so(
        self, settings: Settings, robot: FakeRobot, camera: Camera, press_of: Callable[..., Scene]
    ) -> None:
        with (
            camera,
            pytest.raises(ProtectiveStopError) as caught,
            Station(settings, robot, camera) as station,
        ):
            station.press(press_of())
        told = caught.value.__notes__[0]
        assert "left where it is. The tool is at x 0.00, y 0.00, z 2.35 mm of the work" in told
        assert "2.00 mm past first touch, in contact." in told
        assert robot.tool()[2] > -5.0

    def test_an_interrupt_says_so_in_whole_words(
        self, settings: Settings, robot: FakeRobot, camera: Camera, press_of: Callable[..., Scene]
    ) -> None:
        def press_and_interrupt() -> None:
            with camera, Station(settings, robot, camera) as station:
                with pytest.raises(ProtectiveStopError):
                    station.press(press_of())
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt) as caught:
            press_and_interrupt()
        told = caught.value.__notes__[0]
        assert "the robot is not normal: fake. The tool was left where it is. The tool is" in told

    def test_no_error_becomes_one(
        self, settings: Settings, robot: FakeRobot, camera: Camera, press_of: Callable[..., Scene]
    ) -> None:
        def press_and_draw_back() -> None:
            with camera, Station(settings, robot, camera) as station:
                with pytest.raises(ProtectiveStopError):
                    station.press(press_of())
                with pytest.raises(RobotError, match="left where it is"):
                    station.withdraw()

        with pytest.raises(RobotError, match=r"left where it is\. .* past first touch, in contact"):
            press_and_draw_back()
        assert robot.closed


@pytest.fixture
def shallow() -> Settings:
    return make_settings(contact=FIXED_TOUCH, sensor={"deepest_mm": 1.5})


def test_a_press_is_never_deeper_than_the_sensor_allows(
    shallow: Settings, robot: FakeRobot, camera: Camera, press_of: Callable[..., Scene]
) -> None:
    with camera, Station(shallow, robot, camera) as station:
        station.look_at_rest()
        before = len(robot.moves)
        with pytest.raises(UserError, match=r"2\.00 mm .* allows 1\.5 mm; nothing was moved"):
            station.press(press_of(depth=2.0))
        with pytest.raises(UserError, match="nothing was moved"):
            measure_settling(station, 2.0, 1.0)
        assert len(robot.moves) == before


def test_a_calibration_is_checked_before_it_moves(
    shallow: Settings, robot: FakeRobot, camera: Camera
) -> None:
    with camera, Station(shallow, robot, camera) as station:
        before = len(robot.moves)
        with pytest.raises(UserError, match=r"5 of 5 presses of the calibration are refused"):
            measure_place(station, 4.0, 2.0, 4, lambda _: None)
        with pytest.raises(UserError, match=r"4 of 5 .*half_width_mm"):
            measure_place(station, 14.0, 1.0, 4, lambda _: None)
        assert len(robot.moves) == before


def test_the_speed_of_a_session_is_not_the_data_sets(
    robot: Looking, settings: Settings, tmp_path: Path
) -> None:
    speeds: list[float] = []
    begin = robot.start

    def start(pose: Pose6, speed: float, acceleration: float) -> None:
        speeds.append(speed)
        begin(pose, speed, acceleration)

    robot.start = start  # type: ignore[method-assign]
    assert (
        collect(settings, PLAN, tmp_path / "data", callbacks=Callbacks(), speed_scale=0.1).left == 0
    )
    keys = settings.robot
    assert max(speeds) <= 0.1 * max(keys.retract_mm_s, keys.approach_mm_s) + 1e-9
    dataset = open_dataset(tmp_path / "data")
    recorded = dataset.header.sensor["configuration"]["robot"]
    assert recorded["press_mm_s"] == keys.press_mm_s
    (session,) = (event for event in dataset.events if event["kind"] == "session")
    assert session["configuration"]["robot"]["press_mm_s"] == 0.1 * keys.press_mm_s
