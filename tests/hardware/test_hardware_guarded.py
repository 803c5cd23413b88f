"""Presses of every kind are under the guard of force, and end with a tool that was drawn back."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fake_station import FIXED_TOUCH, FakeRobot, make_settings, stand_in

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import open_dataset
from tactibench.lab import Press
from tactibench_tactip import (
    CollectionPlan,
    GuardError,
    Mover,
    Pose6,
    PressLoop,
    ProtectiveStopError,
    RobotError,
    Settings,
    Station,
    collect,
    dry_run,
    measure_settling,
)

MAIN = threading.main_thread().ident or 0
SCENE = Scene(Indenter.single(), Pose(depth=2.0))
PLAN = CollectionPlan("test", (Press(0, "p", SCENE),), {"all": {"train": [0]}})


class Looking(FakeRobot):
    """The control loop turns a few times in every move."""

    ticks = 0

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        self.busy, self.ticks = True, 3
        super().start(pose, speed, acceleration)

    def moving(self) -> bool:
        self.ticks -= 1
        self.busy = self.busy and self.ticks > 0
        return self.busy


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

    def stopped(mover: Mover, path: Any) -> int:
        moment = down(mover, path)
        robot.normal, robot.stopped = False, True
        return moment

    station.down = stopped  # type: ignore[method-assign]
    with pytest.raises(ProtectiveStopError, match="not normal"), station:
        measure_settling(station, 2.0, 30.0)
    assert time.monotonic() - begin < 10.0


class TestForce:
    def test_of_a_settling_test(self, settings: Settings, robot: Looking) -> None:
        with Station(settings) as station:
            station.look_at_rest()
            robot.stiffness = 20.0
            with pytest.raises(GuardError, match="max_force_n"):
                measure_settling(station, 3.0, 1.0)
            assert robot.depth() == 0.0

    def test_of_a_dry_run(self, settings: Settings, robot: Looking) -> None:
        """Somebody left a hand where the tool goes."""
        begin, robot.force = robot.start, (0.0, 0.0, 0.0)

        def start(pose: Pose6, speed: float, acceleration: float) -> None:
            begin(pose, speed, acceleration)
            robot.force = (0.0, 0.0, 30.0 if len(robot.moves) > 2 else 0.0)

        robot.start = start  # type: ignore[method-assign]
        with pytest.raises(GuardError, match="max_force_n"):
            dry_run(settings, PLAN.presses, 20.0, lambda _: None)

    def test_of_presses_while_somebody_watches(self, settings: Settings, robot: Looking) -> None:
        def stiff() -> None:
            robot.stiffness = 20.0

        with pytest.raises(GuardError, match="max_force_n"):
            watched(PressLoop(settings), stiff)


class TestDrawnBack:
    """The robot is stopped when it holds the deepest place: the tool stays there."""

    def test_by_a_dry_run(
        self, settings: Settings, robot: Looking, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        down = Station.down

        def stopped(station: Station, mover: object, path: object) -> int:
            found = down(station, mover, path)  # type: ignore[arg-type]
            robot.normal, robot.stopped = False, True
            return found

        monkeypatch.setattr(Station, "down", stopped)
        with pytest.raises(RobotError, match="left where it is"):
            dry_run(settings, PLAN.presses, 20.0, lambda _: None)


def watched(presses: PressLoop, first: Callable[[], None] = lambda: None) -> None:
    """Until they ended; first: once the robot is there."""
    with presses:
        first()
        presses.begin()
        assert presses._thread is not None
        presses._thread.join(20.0)
        assert not presses._thread.is_alive()
        assert presses.failed


class TestStopsAtOnce:
    """SIGTERM before the first press: no traceback, and no split."""

    @pytest.fixture
    def low(self, robot: Looking) -> Looking:
        """Stands low, so that entering moves it; a signal comes then."""
        x, y, z, *turn = robot.at
        robot.at = (x, y, z - 35.0, *turn)  # type: ignore[assignment]
        assert robot.tool()[2] > -10.0

        def sent(_: int) -> None:
            robot.ticks = 10**9  # it does not arrive
            signal.pthread_kill(MAIN, signal.SIGTERM)

        robot.fails = sent
        return robot

    def test_a_collection(self, settings: Settings, low: Looking, tmp_path: Path) -> None:
        report = collect(settings, PLAN, tmp_path / "data")
        assert report.interrupted
        assert report.left == 1
        dataset = open_dataset(tmp_path / "data")
        assert dataset.header.status == "open"
        assert not dataset.splits
        assert low.closed

    def test_a_dry_run(self, settings: Settings, low: Looking) -> None:
        assert dry_run(settings, PLAN.presses, 20.0, lambda _: None) == 0
        assert low.closed


def test_a_protective_stop_while_watched_is_told(settings: Settings, robot: Looking) -> None:
    def stop_in_the_skin(_: int) -> None:
        if robot.tool()[2] > 0.5:
            robot.normal, robot.stopped = False, True

    with pytest.raises(RobotError, match="not normal"):
        watched(PressLoop(settings), lambda: setattr(robot, "fails", stop_in_the_skin))
