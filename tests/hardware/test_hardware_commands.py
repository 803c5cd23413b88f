"""The verbs of `tactibench hw`, as a user meets them."""

from __future__ import annotations

import json
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fake_station import EXAMPLE, FIXED_TOUCH, FakeCapture, FakeRobot, stand_in, write_settings
from virtual_lab import VirtualCamera

from tactibench import Indenter, Pose, Scene, SensorContext, UserError, open_sensor
from tactibench.cli.main import call
from tactibench.datasets import open_dataset, verify
from tactibench_tactip import (
    HIGHER_MM,
    OFFSET,
    Camera,
    Station,
    check_setup,
    find_touch,
    read_settings,
)

Said = Callable[[], str]


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    path = tmp_path / "lab.toml"
    path.write_text(EXAMPLE.replace("settle_s = 0.2", "settle_s = 0.0"), encoding="utf-8")
    return path


def plan_file(folder: Path, x: float = 1.0) -> Path:
    path = folder / "plan.jsonl"
    row = {
        "id": 0,
        "indenter": "single",
        "indenter_radius_mm": 3.0,
        "x_mm": x,
        "y_mm": 0.0,
        "depth_mm": 2.0,
    }
    other = {
        **row,
        "id": 1,
        "indenter": "dual",
        "indenter_offsets_mm": [[-4, 0, 0], [4, 0, 0]],
        "x_mm": 0.0,
        "yaw_deg": 20.0,
    }
    path.write_text(f"{json.dumps(row)}\n{json.dumps(other)}\n", encoding="utf-8")
    return path


def test_the_example_is_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "new.toml"
    assert call(["hw", "example", str(path)]) == 0
    assert read_settings(path).robot.driver == "ur"
    assert call(["hw", "example", str(path)]) == 2
    assert "is there already" in capsys.readouterr().err


def test_a_plan_is_shown(lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["hw", "plan", str(plan_file(tmp_path)), "--config", str(lab)]) == 0
    said = capsys.readouterr().out
    assert "mounted" in said
    assert "two tips of radius 3 mm, 8 mm apart" in said
    assert "2 presses" in said
    assert "indenters to mount by hand: 1, which takes about 3 min 0 s more" in said


@pytest.mark.parametrize(
    ("options", "stops", "code", "told"),
    [
        ("--dry-run-height 20", False, 0, "2 presses were moved through 20 mm above"),
        ("--dry-run-height 20", True, 130, "nothing was kept; 1 presses are left"),
        ("", False, 0, "2 good and 0 bad samples"),
        ("--quiet", False, 0, "2 good and 0 bad samples"),
    ],
)
def test_a_collection_ends_with_its_code_and_a_sentence(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: str,
    stops: bool,
    code: int,
    told: str,
) -> None:
    config = tmp_path / "lab.toml"
    robot = FakeRobot(read_settings(write_settings(config, contact=FIXED_TOUCH)))
    stand_in(lambda _: robot, monkeypatch)
    if stops:
        robot.fails = lambda number: signal.raise_signal(signal.SIGINT) if number == 2 else None
    plan = plan_file(tmp_path)
    row = json.loads(plan.read_text().splitlines()[0])
    plan.write_text("\n".join(json.dumps({**row, "id": number}) for number in range(2)))
    arguments = f"hw collect {plan} --config {config} --out {tmp_path / 'data'}"
    assert call([*arguments.split(), *options.split()]) == code
    said = capsys.readouterr()
    assert told in said.out
    assert ("of a robot's time" in said.err) == (not options)


def test_doctor_tells_the_rate_of_frames_that_come_in_bursts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Bursts(FakeCapture):
        def grab(self) -> bool:
            self.count = getattr(self, "count", 0) + 1
            time.sleep(0.03 * (self.count % 3 == 0))
            return super().grab()

    monkeypatch.setattr(Camera, "check_rate", VirtualCamera.check_rate)
    config = write_settings(tmp_path / "lab.toml", camera={"fps": 95.0, "warmup_frames": 20})
    settings = read_settings(config)
    robot = FakeRobot(settings)
    robot.capture = Bursts(robot)
    stand_in(lambda _: robot, monkeypatch)
    (frames,) = (text for _, part, text in check_setup(settings) if " a second" in text)
    rate = re.search(r"([\d.]+) (new frames )?a second", frames)
    assert rate is not None
    assert 20.0 < float(rate[1]) < 110.0  # most gaps are of 1 ms


@pytest.mark.parametrize(
    ("contact", "searches"), [({"every_presses": 2}, 2), ({"every_minutes": 1e-6}, 3), ({}, 1)]
)
def test_the_sensor_finds_first_touch_again_as_configured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, contact: dict[str, float], searches: int
) -> None:
    config, found = tmp_path / "lab.toml", []
    write_settings(config, contact=FIXED_TOUCH | contact)
    stand_in(FakeRobot, monkeypatch)

    def find(station: Station) -> None:
        found.append(station.touch is None)
        find_touch(station)

    monkeypatch.setattr("tactibench_tactip.sensor.find_touch", find)
    context = SensorContext(np.random.SeedSequence(0))
    with open_sensor("tactip", context, {"config": str(config)}) as tactip:
        for x in (0.0, 1.0, 2.0):
            tactip.press(Scene(Indenter.single(), Pose(x, depth=2.0)))
    assert found == [True, False, False][:searches]


@pytest.mark.parametrize(
    ("change", "x", "message"),
    [
        (("", ""), 13.0, "envelope.half_width_mm allows 12 mm"),
        (('driver = "ur"', 'driver = "grbl"'), 1.0, "cannot make; choose draws of single presses"),
        (("approach_mm_s = 20.0", "approach_mm_s = 2000.0"), 1.0, "robot.approach_mm_s"),
    ],
)
def test_a_plan_that_cannot_be_pressed_is_refused_before_any_device(
    lab: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: tuple[str, str],
    x: float,
    message: str,
) -> None:
    lab.write_text(lab.read_text().replace(*change), encoding="utf-8")
    out = tmp_path / "data"
    for verb in (["plan"], ["collect", "--out", str(out)]):
        arguments = ["hw", verb[0], str(plan_file(tmp_path, x)), "--config", str(lab), *verb[1:]]
        assert call(arguments) == 2
        assert message in capsys.readouterr().err
    assert not out.exists()


def test_the_sensor_needs_a_configuration(capsys: pytest.CaptureFixture[str]) -> None:
    tactip = open_sensor("tactip", SensorContext(np.random.SeedSequence(0)), {})
    with pytest.raises(UserError, match=r"sensor.config=FILE.toml"):
        tactip.describe()
    with pytest.raises(UserError, match=r"sensor.config=FILE.toml"), tactip:
        pass


def test_the_sensor_describes_itself_while_closed(lab: Path) -> None:
    context = SensorContext(np.random.SeedSequence(0))
    tactip = open_sensor("tactip", context, {"config": str(lab)})
    assert tactip.describe()["sensor"]["dome_radius_mm"] == 20.0
    json.dumps(tactip.describe())
    with pytest.raises(UserError, match="is closed"):
        tactip.press(Scene(Indenter.single(), Pose(depth=1.0)))


@pytest.mark.long
def test_a_rehearsal_goes_the_whole_way(
    tmp_path: Path, lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Labels are true although first touch lies elsewhere than in the configuration."""
    emulate, data = ["--config", str(lab), "--emulate"], tmp_path / "data"
    assert call(["hw", "doctor", *emulate]) == 0
    assert "all as the configuration says" in capsys.readouterr().out
    assert call(["hw", "jog", *emulate, "--by", "1", "0", "2"]) == 0
    assert "tool is at x 1.00, y 0.00, z -46.00 mm" in capsys.readouterr().out
    assert call(["hw", "collect", str(plan_file(tmp_path)), *emulate, "--out", str(data)]) == 0
    assert "2 good and 0 bad samples" in capsys.readouterr().out  # of two indenters
    assert verify(data) == []
    dataset = open_dataset(data)
    assert dataset.header.sensor["origin"] == "simulated"
    touches = [event["z0_mm"] for event in dataset.events if event["kind"] == "touch"]
    # A touch is seen once it moves the pins, 0.03 to 0.06 mm below the first contact.
    assert touches == pytest.approx([HIGHER_MM] * 2, abs=0.1)


@pytest.mark.long
def test_a_rehearsed_calibration_finds_the_sensor(
    lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Which noise a frame has depends on the clock: 18 runs scattered by 0.035 mm and 0.1 deg."""
    assert call(["hw", "calibrate", "--config", str(lab), "--emulate", "--points", "4"]) == 0
    said = capsys.readouterr().out
    x, y, yaw = (float(text) for text in re.findall(r"-?[\d.]+", said.splitlines()[0])[:3])
    assert (x, y) == pytest.approx(OFFSET[:2], abs=0.18)  # 5 times the scatter
    assert yaw == pytest.approx(OFFSET[2], abs=1.0)
    height = re.search(r"first touch at z ([+-][\d.]+)", said)
    assert height is not None
    assert float(height[1]) == pytest.approx(HIGHER_MM, abs=0.1)


@pytest.mark.long
def test_the_sensor_can_be_rehearsed(tmp_path: Path) -> None:
    config = write_settings(tmp_path / "lab.toml", robot={"address": "simulated"})
    context = SensorContext(np.random.SeedSequence(0))
    with open_sensor("tactip", context, {"config": str(config)}) as tactip:
        assert tactip.describe()["origin"] == "simulated"
        frame = tactip.press(Scene(Indenter.single(), Pose(1.0, -1.0, depth=2.0)))
        assert frame.pose.depth == pytest.approx(2.0, abs=0.05)
        assert np.abs(frame.image.astype(float) - tactip.rest().image).mean() > 1.0
