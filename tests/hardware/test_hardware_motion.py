"""One thread owns the robot; every target is checked, every wait ends, the tool is drawn back."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import pytest
from fake_station import FakeRobot, make_settings

from tactibench import Scene, UserError
from tactibench_tactip import (
    Camera,
    GuardError,
    Mover,
    Pose6,
    ProtectiveStopError,
    RobotError,
    RobotState,
    RobotThread,
    Settings,
    Station,
    StopNowError,
    geometry_of,
    matrix,
    pose_of,
    stop_signals,
)


@pytest.fixture
def mover(robot: FakeRobot, settings: Settings) -> Mover:
    return Mover(robot, settings, threading.Event())


def test_a_target_outside_the_envelope_never_reaches_the_robot(
    mover: Mover, robot: FakeRobot
) -> None:
    with pytest.raises(RobotError, match=r"half_width_mm.*nothing was moved"):
        mover.go((20.0, 0.0, 0.0, 0.0, 0.0, 0.0), 5.0)
    assert robot.moves == []


@pytest.mark.parametrize(("stopped", "kind"), [(True, ProtectiveStopError), (False, RobotError)])
def test_a_robot_that_is_not_normal_is_not_moved(
    mover: Mover, robot: FakeRobot, stopped: bool, kind: type[RobotError]
) -> None:
    robot.normal, robot.stopped = False, stopped
    with pytest.raises(kind, match="not normal"):
        mover.go((0.0, 0.0, -20.0, 0.0, 0.0, 0.0), 5.0)
    assert robot.moves == []


def test_a_move_that_never_ends_is_stopped(
    mover: Mover, robot: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactibench_tactip.motion.patience", lambda *_: 0.02)
    robot.busy = True
    with pytest.raises(RobotError, match="took longer than"):
        mover.go((0.0, 0.0, -20.0, 0.0, 0.0, 0.0), 5.0)
    assert robot.stops == 1


def test_halt_stops_a_move_and_refuses_the_next(robot: FakeRobot, settings: Settings) -> None:
    halt = threading.Event()
    mover = Mover(robot, settings, halt)
    robot.busy = True
    robot.fails = lambda _: halt.set()
    with pytest.raises(StopNowError):
        mover.go((0.0, 0.0, -20.0, 0.0, 0.0, 0.0), 5.0)
    assert robot.stops == 1
    with pytest.raises(StopNowError):
        mover.go((0.0, 0.0, -21.0, 0.0, 0.0, 0.0), 5.0)
    assert len(robot.moves) == 1


class Slowed(FakeRobot):
    """It moves a hundredth of its way at a turn of 4 ms or more, under the pendant's slider."""

    share, left, way = 1.0, 0, (0.0, 0.0, 0.0)

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        x, y, z = ((b - a) / 100.0 for a, b in zip(self.at[:3], pose[:3], strict=True))
        self.moves.append(pose)
        self.way, self.left = (x, y, z), 100

    def moving(self) -> bool:
        if self.left:
            x, y, z = (a + b for a, b in zip(self.at[:3], self.way, strict=True))
            self.at, self.left = (x, y, z, *self.at[3:]), self.left - 1
        return self.left > 0

    def stop(self) -> None:
        self.stops, self.left = self.stops + 1, 0

    def state(self) -> RobotState:
        return replace(super().state(), speed_share=self.share)


@pytest.mark.parametrize(
    ("share", "z", "message"),
    [
        (1.0, -20.0, r"took longer than 0\.1 s; look"),
        (0.5, -20.0, r"took longer than 0\.2 s with the speed slider at 50 %"),
        (0.02, -20.0, ""),
        (1.0, -59.0, ""),  # the way out
    ],
)
def test_the_slider_is_part_of_the_time_and_the_way_out_has_all_of_it(
    settings: Settings, monkeypatch: pytest.MonkeyPatch, share: float, z: float, message: str
) -> None:
    monkeypatch.setattr("tactibench_tactip.motion.move_seconds", lambda *_: 0.1)
    monkeypatch.setattr("tactibench_tactip.motion.patience", lambda seconds: seconds)
    monkeypatch.setattr("tactibench_tactip.motion.TICK_S", 0.004)
    robot = Slowed(settings)
    robot.share = share
    mover = Mover(robot, settings, threading.Event())
    with pytest.raises(RobotError, match=message) if message else nullcontext():
        mover.go((0.0, 0.0, z, 0.0, 0.0, 0.0), 5.0)
    assert robot.stops == bool(message)


@pytest.mark.parametrize(
    ("keys", "speed", "down", "moves"),
    [
        ({"driver": "grbl"}, 5.0, 3.0, 6),
        ({"driver": "cri"}, 1.0, 0.2, 1),
        ({"driver": "grbl"}, 5.0, -15.0, 1),  # the way out
        ({"driver": "ur"}, 5.0, 3.0, 1),  # its watchdog stops it within 0.5 mm
        ({"driver": "ur"}, 20.0, 3.0, 6),
        ({"driver": "ur", "watchdog_hz": 2.0}, 5.0, 3.0, 6),
    ],
)
def test_a_move_that_may_touch_is_short_where_nobody_watches_it(
    keys: dict[str, Any], speed: float, down: float, moves: int
) -> None:
    settings = make_settings(robot=keys)
    robot = FakeRobot(settings)
    mover = Mover(robot, settings, threading.Event())
    x, y, z, *turn = mover.pose()
    mover.go_in_touch((x, y, z + down, *turn), speed, lambda _: "")  # type: ignore[arg-type]
    assert len(robot.moves) == moves
    assert mover.pose()[:3] == pytest.approx((x, y, z + down))


def test_neither_force_nor_the_envelope_stops_the_way_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = make_settings(envelope={"above_mm": 5.0, "clearance_mm": 10.0})
    monkeypatch.setattr("tactibench_tactip.motion.TICK_S", 0.001)
    robot = Slowed(settings)
    robot.at = pose_of(robot.work @ matrix((0.0, 0.0, 3.0, 0.0, 0.0, 0.0)))
    mover = Mover(robot, settings, threading.Event())
    guard = mover.force_guard()
    robot.force = (0.0, 0.0, 99.0)
    mover.go((0.0, 0.0, 1.0, 0.0, 0.0, 0.0), 5.0, lambda _: "force")
    assert guard(mover.pose()) == ""  # no force was measured before
    mover.raise_straight(geometry_of(settings))
    assert mover.pose()[2] == pytest.approx(-10.0)
    with pytest.raises(GuardError, match="force"):
        mover.go((0.0, 0.0, 2.0, 0.0, 0.0, 0.0), 5.0, lambda _: "force")


def test_a_tool_beside_its_line_is_stopped_also_without_a_guard(
    mover: Mover, robot: FakeRobot
) -> None:
    robot.busy = True
    beside = pose_of(robot.work @ matrix((3.0, 0.0, -30.0, 0.0, 0.0, 0.0)))
    robot.start = lambda *_: setattr(robot, "at", beside)  # type: ignore[method-assign]
    with pytest.raises(GuardError, match=r"3\.0 mm beside its line"):
        mover.go((0.0, 0.0, -20.0, 0.0, 0.0, 0.0), 5.0)
    assert robot.stops == 1


def test_too_much_force_is_a_reason(robot: FakeRobot) -> None:
    mover = Mover(robot, make_settings(envelope={"max_force_n": 5.0}), threading.Event())
    robot.force = (0.0, 0.0, 2.0)
    guard = mover.force_guard()
    assert guard(mover.pose()) == ""
    robot.force = (0.0, 3.0, -2.5)
    assert "max_force_n" in guard(mover.pose())
    robot.force = None
    assert "no longer tells its force" in guard(mover.pose())
    assert mover.force_guard()(mover.pose()) == ""  # it never measured one


def test_a_place_that_is_no_number_ends_a_move(mover: Mover, robot: FakeRobot) -> None:
    robot.busy = True
    robot.fails = lambda _: setattr(robot, "pose", lambda: (float("nan"),) * 6)
    with pytest.raises(GuardError, match="beside its line"):
        mover.go((0.0, 0.0, -20.0, 0.0, 0.0, 0.0), 5.0)
    assert robot.stops == 1


def test_a_robot_that_goes_on_after_it_was_told_to_stop_is_said(
    mover: Mover, robot: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactibench_tactip.motion.STOP_S", 0.02)
    robot.moving = lambda: True  # type: ignore[method-assign]
    with pytest.raises(RobotError, match=r"still moves 0\.02 s after it was told to stop"):
        mover.stop()


def test_a_robot_that_was_held_is_noticed(
    mover: Mover, robot: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stops on its way: not tried again. It does not move at all: tried once more."""
    monkeypatch.setattr("tactibench_tactip.motion.GRACE_S", 0.02)
    at = robot.at

    def held(_: int) -> None:
        robot.start = lambda *_: setattr(robot, "at", (at[0], at[1], at[2] - 3.0, *at[3:]))  # type: ignore[method-assign,assignment]

    robot.fails = held
    mover.go((0.0, 0.0, -40.0, 0.0, 0.0, 0.0), 5.0)
    with pytest.raises(RobotError, match="before its target"):
        mover.go((0.0, 0.0, -30.0, 0.0, 0.0, 0.0), 5.0)
    calls: list[int] = []
    robot.start = lambda *_: calls.append(1)  # type: ignore[method-assign,assignment]
    with pytest.raises(RobotError, match="before its target"):
        mover.go((0.0, 0.0, -20.0, 0.0, 0.0, 0.0), 5.0)
    assert len(calls) == 2


def test_the_tool_is_drawn_back_along_the_press(
    mover: Mover, robot: FakeRobot, settings: Settings, press_of: Callable[..., Scene]
) -> None:
    geometry = geometry_of(settings)
    scene = press_of(4.0, -3.0, 5.0)
    mover.go(geometry.at_depth(scene, -10.0), 20.0)
    mover.go(geometry.at_depth(scene, 3.0), 5.0)
    x, y, *_ = mover.pose()
    mover.withdraw(scene, geometry)
    after = mover.pose()
    assert after[:2] == pytest.approx((x, y), abs=1e-6)
    assert after[2] == pytest.approx(-settings.envelope.clearance_mm)
    count = len(robot.moves)
    mover.withdraw(scene, geometry)
    assert len(robot.moves) == count  # high enough already


def test_a_robot_that_hangs_is_left_behind(robot: FakeRobot) -> None:
    event = threading.Event()
    robot.connect = lambda _: event.wait(5.0)  # type: ignore[method-assign,assignment,return-value]
    settings = make_settings(robot={"connect_s": 0.02})
    with pytest.raises(RobotError, match=r"did not answer within 0\.02 s"):
        RobotThread(robot, settings).__enter__()
    assert robot.closed
    event.set()


def test_only_one_thread_touches_the_robot(robot: FakeRobot, settings: Settings) -> None:
    names: set[str] = set()
    robot.fails = lambda _: names.add(threading.current_thread().name)
    with RobotThread(robot, settings) as owner:
        for z in (-20.0, -25.0):
            owner.do(lambda m, z=z: m.go((0.0, 0.0, z, 0.0, 0.0, 0.0), 5.0))
    assert names == {"tactip robot"}
    assert robot.closed


class TestStation:
    def test_a_tool_outside_the_envelope_is_not_moved(
        self, settings: Settings, robot: FakeRobot, camera: Camera
    ) -> None:
        x, y, z, *turn = robot.at
        robot.at = (x + 50.0, y, z, *turn)  # type: ignore[assignment]
        with pytest.raises(UserError, match=r"stands at.*hw jog"), Station(settings, robot, camera):
            pass
        assert robot.moves == []
        assert robot.closed

    @pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
    def test_any_error_in_a_press_draws_the_tool_back(
        self,
        settings: Settings,
        robot: FakeRobot,
        camera: Camera,
        error: type[BaseException],
        press_of: Callable[..., Scene],
    ) -> None:
        def at_fourth(number: int) -> None:
            if robot.tool()[2] > -5.0:
                robot.fails = lambda _: None
                raise error

        robot.fails = at_fourth
        with pytest.raises(error), Station(settings, robot, camera) as station:
            station.press(press_of())
        assert robot.tool()[2] == pytest.approx(-settings.envelope.clearance_mm)
        assert robot.closed


@pytest.mark.usefixtures("interruptible")
def test_the_first_interrupt_asks_and_the_second_or_sigterm_stops() -> None:
    told: list[str] = []
    stopped: list[int] = []
    with stop_signals(told.append, lambda: stopped.append(1)) as ended:
        signal.raise_signal(signal.SIGINT)
        assert (ended.is_set(), stopped) == (True, [])
        signal.raise_signal(signal.SIGINT)
        assert stopped == [1]
    assert "Ctrl-C again" in told[0]
    with stop_signals(told.append, lambda: stopped.append(2)) as ended:
        signal.raise_signal(signal.SIGTERM)
        assert ended.is_set()
    assert stopped == [1, 2]
