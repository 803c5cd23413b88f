"""A stop is never lost, and a tool that was left in the skin is told of."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator

import pytest
from fake_station import FakeRobot

from tactibench import Scene
from tactibench_tactip import (
    Camera,
    Mover,
    Pose6,
    ProtectiveStopError,
    RobotError,
    RobotThread,
    Settings,
    Station,
)

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
def robot(settings: Settings) -> SlowRobot:
    return SlowRobot(settings)


def withdrawn_after_a_stop(robot: SlowRobot) -> bool:
    after = robot.log[robot.log.index("slow") + 1 :]
    clear = -robot.settings.envelope.clearance_mm
    return after[0] == "stop" and after[-1] == "start" and robot.tool()[2] < clear + 0.1


def test_a_descent_that_takes_too_long_is_stopped_before_it_is_drawn_back(
    settings: Settings,
    robot: SlowRobot,
    camera: Camera,
    press_of: Callable[..., Scene],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with camera, Station(settings, robot, camera) as station:
        station.look_at_rest()
        monkeypatch.setattr("tactibench_tactip.station.patience", lambda *_: 0.05)
        with pytest.raises(RobotError, match="told to stop"):
            station.press(press_of())
        assert withdrawn_after_a_stop(robot)
        assert not station.robot_thread.halt.is_set()


@pytest.fixture
def interruptible() -> Iterator[None]:
    """A process that was started in the background has SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_stops_a_descent(
    settings: Settings, robot: SlowRobot, camera: Camera, press_of: Callable[..., Scene]
) -> None:
    """Also where nobody installed handlers of signals."""
    main = threading.get_ident()
    with camera, Station(settings, robot, camera) as station:
        station.look_at_rest()
        robot.begun = lambda: signal.pthread_kill(main, signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            station.press(press_of())
        assert withdrawn_after_a_stop(robot)


def test_a_job_that_nobody_waits_for_is_never_begun(robot: SlowRobot, settings: Settings) -> None:
    held = threading.Event()
    begun: list[str] = []

    def hold(_: Mover) -> None:
        held.wait(5.0)

    with RobotThread(robot, settings) as owner:
        for job in (hold, lambda _: begun.append("late")):
            with pytest.raises(RobotError, match="told to stop"):
                owner.do(job, 0.02)
        held.set()
    assert begun == []


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
        assert "left where it is, at a press" in caught.value.__notes__[0]
        assert robot.tool()[2] > -5.0

    def test_no_error_becomes_one(
        self, settings: Settings, robot: FakeRobot, camera: Camera, press_of: Callable[..., Scene]
    ) -> None:
        def press_and_draw_back() -> None:
            with camera, Station(settings, robot, camera) as station:
                with pytest.raises(ProtectiveStopError):
                    station.press(press_of())
                with pytest.raises(RobotError, match="left where it is"):
                    station.draw_back()

        with pytest.raises(RobotError, match="left where it is, at a press"):
            press_and_draw_back()
        assert robot.closed
