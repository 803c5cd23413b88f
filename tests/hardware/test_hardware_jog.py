"""A hand-driven move: inside the envelope, sideways at clearance only, under the guard of force."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from fake_station import EXAMPLE, STAGE, FakeRobot, Looking, make_settings, stand_in

from tactibench import UserError
from tactibench.cli.main import call
from tactibench_tactip import (
    Pose6,
    Settings,
    check_way,
    matrix,
    pose_of,
)


def at(x: float, y: float, z: float) -> Pose6:
    return (x, y, z, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("here", "there", "message"),
    [
        (at(0, 0, -40), at(5, 5, -11), ""),
        (at(0, 0, -40), at(0, 0, 3), ""),
        (at(0, 0, 3), at(0, 0, -20), ""),
        (at(40, 0, -40), at(5, 0, -20), ""),
        (at(0, 0, 12), at(0, 0, -20), ""),
        (at(0, 0, 3), at(2, 0, 3), "sideways at z 3.0 mm"),
        (at(0, 0, 3), at(2, 0, -20), "sideways at z 3.0 mm"),
        (at(0, 0, -20), at(2, 0, -5), "sideways at z -5.0 mm"),
        (at(40, 0, 5), at(5, 0, 5), "sideways at z 5.0 mm"),
        (at(0, 0, -20), at(13, 0, -20), "half_width_mm"),
        (at(0, 0, -20), at(0, 0, float("nan")), "above_mm"),
    ],
)
def test_the_whole_way_is_checked(
    settings: Settings, here: Pose6, there: Pose6, message: str
) -> None:
    if not message:
        check_way(here, there, settings)
        return
    with pytest.raises(UserError, match=message) as caught:
        check_way(here, there, settings)
    assert "othing was moved" in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "code", "homes"),
    [
        ("", 0, [False]),
        ("--home --yes", 0, [True]),
        ("--by 0 0 1 --yes", 0, [True]),
        ("--by 0 0 1", 130, []),  # nobody says that the way is clear
        ("--home", 130, []),
    ],
)
def test_a_stage_is_homed_only_where_something_is_to_move(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: str, code: int, homes: list[bool]
) -> None:
    """Connecting alone would home it, because robot.home = true."""
    config = tmp_path / "lab.toml"
    config.write_text(STAGE)
    connected: list[bool] = []

    def make(settings: Settings) -> FakeRobot:
        connected.append(settings.robot.home)
        return FakeRobot(settings)

    stand_in(make, monkeypatch)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert call(["hw", "jog", "--config", str(config), *arguments.split()]) == code
    assert connected == homes


def test_force_stops_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "lab.toml"
    config.write_text(EXAMPLE)
    robot = Looking(make_settings())
    robot.at = pose_of(robot.work @ matrix(at(0, 0, -1)))
    robot.stiffness = 20.0
    stand_in(lambda _: robot, monkeypatch)
    arguments: list[Any] = ["hw", "jog", "--config", str(config), "--by", "0", "0", "3", "--yes"]
    assert call(arguments) == 2
    assert "envelope.max_force_n allows 15 N" in capsys.readouterr().err
    assert robot.stops == 1
    assert robot.closed
