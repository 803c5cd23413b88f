"""Limits that hold wherever something is pressed, and what of a session is not the data set's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from fake_station import FIXED_TOUCH, TRUE_Z0, FakeRobot, make_settings, stand_in

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.cli.main import call
from tactibench.datasets import open_dataset
from tactibench.lab import Press
from tactibench_tactip import collection
from tactibench_tactip.camera import Camera
from tactibench_tactip.commands.calibrate import calibrate
from tactibench_tactip.commands.settle_test import measure_settling
from tactibench_tactip.plan import CollectionPlan
from tactibench_tactip.settings import Settings, example_configuration
from tactibench_tactip.station import Station

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
            calibrate(station, 4.0, 2.0, 4, lambda _: None)
        with pytest.raises(UserError, match=r"4 of 5 .*half_width_mm"):
            calibrate(station, 14.0, 1.0, 4, lambda _: None)
        assert moves_of(robot) == before


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch, settings: Settings) -> FakeRobot:
    """The robot of every station that is made, with a camera beside it."""
    robot = FakeRobot(settings)
    stand_in(robot, monkeypatch.setattr)
    return robot


def written(folder: Path, **tables: dict[str, object]) -> Path:
    """A configuration of ``make_settings`` as a file."""
    text = (
        example_configuration("ur")
        .replace("pins = 127", "")
        .replace("settle_s = 0.2", "settle_s = 0.0")
    )
    text = (
        text[: text.index("[camera]")]
        + ('[camera]\nsource = "fake"\nfps = 500.0\nwarmup_frames = 3\n\n')
        + text[text.index("[sensor]") :]
    )
    text = text.replace('method = "visual"', f'method = "fixed"\nfixed_mm = {TRUE_Z0}')
    text = text.replace(
        "deepest_mm = 6.5", f"deepest_mm = {tables.get('sensor', SHALLOW)['deepest_mm']}"
    )
    path = folder / "lab.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_settling_test_is_checked_before_anything_is_opened(
    lab: FakeRobot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = written(tmp_path)
    assert call(["hw", "settle-test", "--config", str(config), "--depth", "3"]) == 2
    assert "sensor.deepest_mm allows 1.5 mm" in capsys.readouterr().err
    assert lab.moves == []


def test_presses_of_a_data_set_are_checked_before_they_are_repeated(
    lab: FakeRobot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    deep = make_settings(contact=FIXED_TOUCH)
    collection.collect(deep, PLAN, tmp_path / "data")
    before = moves_of(lab)
    config = written(tmp_path)
    assert call(["hw", "replay", str(tmp_path / "data"), "--config", str(config)]) == 2
    assert "sensor.deepest_mm allows 1.5 mm" in capsys.readouterr().err
    assert moves_of(lab) == before


def test_presses_are_repeated_as_they_were_made(
    lab: FakeRobot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A protocol's yaw of a single tip is left out by both."""
    turned = Press(0, "p", Scene(Indenter.single(), Pose(depth=2.0, yaw=150.0)))
    deep = make_settings(contact=FIXED_TOUCH)
    collection.collect(deep, CollectionPlan("test", (turned,), {}), tmp_path / "data")
    lowest = max(lab.moves, key=lambda pose: -pose[2])
    lab.moves.clear()
    config = written(tmp_path, sensor={"deepest_mm": 6.5})
    assert call(["hw", "replay", str(tmp_path / "data"), "--config", str(config)]) == 0
    assert max(lab.moves, key=lambda pose: -pose[2]) == pytest.approx(lowest)
    assert "mean change" in capsys.readouterr().out


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
        collection.collect(settings, PLAN, folder, speed_scale=0.1)
    keys = settings.robot
    assert max(speeds) <= 0.1 * max(keys.retract_mm_s, keys.approach_mm_s) + 1e-9
    lab.fails = lambda _: None
    assert collection.collect(settings, PLAN, folder).left == 0
    dataset = open_dataset(folder)
    recorded = dataset.header.sensor["configuration"]["robot"]
    assert recorded["press_mm_s"] == keys.press_mm_s
    sessions = [event for event in dataset.events if event["kind"] == "session"]
    assert [event["press_mm_s"] for event in sessions] == [0.1 * keys.press_mm_s, keys.press_mm_s]
