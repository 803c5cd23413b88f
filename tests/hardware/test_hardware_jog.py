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
        (at(0, 0, 12), at(0, 0, 11), ""),
        (at(0, 0, 12), at(0, 0, 13), "below_mm"),
        (at(0, 0, -90), at(0, 0, -80), ""),
        (at(40, 0, -40), at(30, 0, -40), ""),
        (at(40, 0, -40), at(41, 0, -40), "half_width_mm"),
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
    ("arguments", "answer", "code", "purposes"),
    [
        ("", "", 0, ["look"]),
        ("--home --yes", "", 0, ["home"]),
        ("--by 0 0 1 --yes", "", 0, ["move"]),
        ("--by 0 0 1", "y\n", 0, ["move"]),
        ("--by 0 0 1", "n\n", 2, []),
        ("--by 0 0 1", "", 2, []),  # nobody can say that the way is clear
        ("--home", "", 2, []),
    ],
)
def test_a_robot_is_read_only_unless_something_is_to_move(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: str,
    answer: str,
    code: int,
    purposes: list[str],
) -> None:
    config = tmp_path / "lab.toml"
    config.write_text(STAGE)
    asked: list[str] = []
    robot = FakeRobot(make_settings())
    robot.connect = asked.append  # type: ignore[method-assign]
    stand_in(lambda _: robot, monkeypatch)
    monkeypatch.setattr("sys.stdin", io.StringIO(answer))
    assert call(["hw", "jog", "--config", str(config), *arguments.split()]) == code
    assert asked == purposes
    assert ("--yes where nobody can" in capsys.readouterr().err) == (code == 2)


@pytest.mark.parametrize(
    ("here", "to", "code"), [(at(0, 0, -90), -20, 0), (at(0, 0, 12), -20, 0), (at(0, 0, 12), 14, 2)]
)
def test_a_tool_outside_is_brought_in_also_in_small_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, here: Pose6, to: float, code: int
) -> None:
    config = tmp_path / "lab.toml"
    config.write_text(EXAMPLE.replace('driver = "ur"', 'driver = "cri"'))
    robot = FakeRobot(make_settings(robot={"driver": "cri"}))
    robot.at = pose_of(robot.work @ matrix(here))
    stand_in(lambda _: robot, monkeypatch)
    arguments = ["hw", "jog", "--config", str(config), "--to", "0", "0", str(to), "--yes"]
    assert call(arguments) == code
    assert robot.tool()[2] == pytest.approx(here[2] if code else to)


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
    told = capsys.readouterr()
    assert "envelope.max_force_n allows 15 N" in told.err
    assert "z 2.00 mm of the work frame, 2.00 mm past first touch, in contact" in told.out
    assert robot.stops == 1
    robot.closed = False
    robot.force = (0.0, 0.0, 99.0)
    assert call([*arguments[:-2], "-30", "--yes"]) == 0  # the way out is free
    assert "clear of the sensor" in capsys.readouterr().out
    assert robot.closed
