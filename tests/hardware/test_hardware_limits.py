"""Limits that hold wherever something is pressed, and what of a session is not the data set's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from fake_station import FIXED_TOUCH, FakeRobot, make_settings, stand_in

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import open_dataset
from tactibench.lab import Press
from tactibench_tactip import (
    Camera,
    CollectionPlan,
    Settings,
    Station,
    collect,
    measure_place,
    measure_settling,
)

SHALLOW = {"deepest_mm": 1.5}
PLAN = CollectionPlan(
    "test",
    tuple(Press(k, f"p{k}", Scene(Indenter.single(), Pose(depth=2.0))) for k in range(2)),
    {"all": {"train": [0]}},
)


@pytest.fixture
def settings() -> Settings:
    return make_settings(contact=FIXED_TOUCH, sensor=SHALLOW)


def moves_of(robot: FakeRobot) -> int:
    return len(robot.moves)


def test_a_press_is_never_deeper_than_the_sensor_allows(
    settings: Settings, robot: FakeRobot, camera: Camera, press_of: Callable[..., Scene]
) -> None:
    with camera, Station(settings, robot, camera) as station:
        station.look_at_rest()
        before = moves_of(robot)
        with pytest.raises(UserError, match=r"2\.00 mm .* allows 1\.5 mm; nothing was moved"):
            station.press(press_of(depth=2.0))
        with pytest.raises(UserError, match="nothing was moved"):
            measure_settling(station, 2.0, 1.0)
        assert moves_of(robot) == before


def test_a_calibration_is_checked_before_it_moves(
    settings: Settings, robot: FakeRobot, camera: Camera
) -> None:
    with camera, Station(settings, robot, camera) as station:
        before = moves_of(robot)
        with pytest.raises(UserError, match=r"5 of 5 presses of the calibration are refused"):
            measure_place(station, 4.0, 2.0, 4, lambda _: None)
        with pytest.raises(UserError, match=r"4 of 5 .*half_width_mm"):
            measure_place(station, 14.0, 1.0, 4, lambda _: None)
        assert moves_of(robot) == before


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch, settings: Settings) -> FakeRobot:
    """The robot of every station that is made, with a camera beside it."""
    robot = FakeRobot(settings)
    stand_in(lambda _: robot, monkeypatch)
    return robot


def test_the_speed_of_a_session_is_not_the_data_sets(
    lab: FakeRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = make_settings(contact=FIXED_TOUCH)
    speeds: list[float] = []
    begin = lab.start

    def start(pose: object, speed: float, acceleration: float) -> None:
        speeds.append(speed)
        begin(pose, speed, acceleration)  # type: ignore[arg-type]

    monkeypatch.setattr(lab, "start", start)
    folder = tmp_path / "data"
    lab.fails = lambda n: (_ for _ in ()).throw(RuntimeError("x")) if n == 4 else None
    with pytest.raises(RuntimeError):
        collect(settings, PLAN, folder, speed_scale=0.1)
    keys = settings.robot
    assert max(speeds) <= 0.1 * max(keys.retract_mm_s, keys.approach_mm_s) + 1e-9
    lab.fails = lambda _: None
    assert collect(settings, PLAN, folder).left == 0
    dataset = open_dataset(folder)
    recorded = dataset.header.sensor["configuration"]["robot"]
    assert recorded["press_mm_s"] == keys.press_mm_s
    sessions = [event for event in dataset.events if event["kind"] == "session"]
    assert [event["press_mm_s"] for event in sessions] == [0.1 * keys.press_mm_s, keys.press_mm_s]
