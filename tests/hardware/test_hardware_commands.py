"""The verbs of `tactibench hw`, as a user meets them."""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fake_station import FIXED_TOUCH, FakeRobot, make_settings, stand_in

from tactibench import Indenter, Pose, Scene, SensorContext, UserError, open_sensor
from tactibench.cli.main import call
from tactibench_tactip import sensor
from tactibench_tactip.commands import VERBS
from tactibench_tactip.commands.emulate import as_toml
from tactibench_tactip.commands.output import open_devices
from tactibench_tactip.settings import Settings, example_configuration, read_settings
from tactibench_tactip.station import Station

Said = Callable[[], str]


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    path = tmp_path / "lab.toml"
    path.write_text(example_configuration("ur"), encoding="utf-8")
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


@pytest.mark.parametrize("verb", sorted(VERBS))
def test_every_verb_has_a_help(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["hw", verb, "--help"]) == 0
    assert "Usage" in capsys.readouterr().out


def test_a_misspelt_verb(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["hw", "colect"]) == 2
    assert "did you mean 'collect'?" in capsys.readouterr().err


def test_help_and_list_load_nothing_heavy() -> None:
    code = (
        "import sys\nfrom tactibench.cli.main import call\ncall(['hw', '--help'])\n"
        "print(*sorted({'numpy', 'torch', 'cv2', 'pydantic', 'serial'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.splitlines()[-1] == ""


def test_emulate_writes_a_configuration_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "new.toml"
    assert call(["hw", "emulate", "--driver", "grbl", "--write", str(path)]) == 0
    assert read_settings(path).robot.driver == "grbl"
    assert call(["hw", "emulate", "--write", str(path)]) == 2
    assert "is there already" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize(("driver", "happens"), [("ur", "happened"), ("grbl", "did not happen")])
def test_emulate_prints_a_configuration_that_can_be_read(
    driver: str, happens: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("fault protective-stop\nquit\n"))
    assert call(["hw", "emulate", "--driver", driver]) == 0
    configuration, _, answer = capsys.readouterr().out.rpartition("protective-stop ")
    assert answer.startswith(happens)
    settings = Settings.model_validate(tomllib.loads(configuration))
    assert settings.robot.watchdog_hz == 10.0
    assert settings.robot.driver == driver


def test_a_note_at_an_error_is_told(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    error = UserError("it failed.")
    error.add_note("the tool was left where it is")
    with pytest.raises(UserError), open_devices(lab, False, 1.0):
        raise error
    assert capsys.readouterr().err == "the tool was left where it is\n"


def test_a_plan_is_shown(lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, figures = tmp_path / "plan.png", tmp_path / "plan.json"
    arguments = ["hw", "plan", str(plan_file(tmp_path)), "--config", str(lab)]
    assert call([*arguments, "--out", str(out), "--json", str(figures)]) == 0
    said = capsys.readouterr().out
    assert "mounted" in said
    assert "two tips of radius 3 mm, 8 mm apart" in said
    assert "2 presses" in said
    assert "a hand mounts an indenter 1 time: about 3 min more, 3 min each" in said
    assert out.read_bytes().startswith(b"\x89PNG")
    rows = json.loads(figures.read_text())
    assert {"metric": "presses", "group": "one tip of radius 3 mm", "value": 1, "unit": ""} in rows


@pytest.mark.parametrize("verb", ["plan exp1", "settle-test", "live unet"])
@pytest.mark.parametrize(
    ("name", "message"),
    [("view.txt", "call it view.png"), ("no/view.png", "is not there; make it")],
)
def test_a_picture_that_cannot_be_written_is_refused_before_any_work(
    lab: Path, capsys: pytest.CaptureFixture[str], verb: str, name: str, message: str
) -> None:
    out = lab.parent / name
    assert call(["hw", *verb.split(), "--config", str(lab), "--out", str(out)]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "stops", "code", "figures"),
    [
        ("--dry-run-height 20", False, 0, {"made": 2, "left": 0}),
        ("--dry-run-height 20", True, 130, {"made": 1, "left": 1}),
        ("", False, 0, {"ok": 2, "bad": 0}),
        ("--quiet", False, 0, {"ok": 2, "bad": 0}),
    ],
)
def test_a_collection_ends_with_its_code_and_figures(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: str,
    stops: bool,
    code: int,
    figures: dict[str, int],
) -> None:
    settings = make_settings(contact=FIXED_TOUCH)
    config, json_file = tmp_path / "lab.toml", tmp_path / "figures.json"
    config.write_text(as_toml(settings))
    robot = FakeRobot(settings)
    stand_in(robot, monkeypatch.setattr)
    if stops:
        robot.fails = lambda number: signal.raise_signal(signal.SIGINT) if number == 2 else None
    plan = plan_file(tmp_path)
    row = json.loads(plan.read_text().splitlines()[0])
    plan.write_text("\n".join(json.dumps({**row, "id": number}) for number in range(2)))
    arguments = f"hw collect {plan} --config {config} --out {tmp_path / 'data'} --json {json_file}"
    assert call([*arguments.split(), *options.split()]) == code
    values = {row["group"]: row["value"] for row in json.loads(json_file.read_text())}
    assert figures.items() <= values.items()
    assert ("of a robot's time" in capsys.readouterr().err) == (not options)


@pytest.mark.parametrize(
    ("contact", "searches"), [({"every_presses": 2}, 2), ({"every_minutes": 1e-6}, 3), ({}, 1)]
)
def test_the_sensor_finds_first_touch_again_as_configured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, contact: dict[str, float], searches: int
) -> None:
    settings = make_settings(contact=FIXED_TOUCH | contact)
    config, found = tmp_path / "lab.toml", []
    config.write_text(as_toml(settings))
    stand_in(FakeRobot(settings), monkeypatch.setattr)

    def find(station: Station, *, first: bool) -> None:
        found.append(first)

    monkeypatch.setattr(sensor, "find_touch", find)
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


@pytest.mark.slow
@pytest.mark.parametrize("driver", ["ur", "grbl"])
def test_a_rehearsed_collection_feeds_a_run(
    driver: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With real clients and emulators."""
    if driver == "ur":
        pytest.importorskip("rtde_control", reason="ur_rtde is not installed")
    config, data = tmp_path / "lab.toml", str(tmp_path / "data")
    config.write_text(example_configuration(driver), encoding="utf-8")
    rehearse = f"--config {config} --emulate --time-scale 20 --draw singles --count 40"
    assert call(["hw", "collect", "exp1", *rehearse.split(), "--out", data]) == 0
    assert "40 good and 0 bad samples" in capsys.readouterr().out
    assert call(["data", "verify", data]) == 0
    run = f"--sensor recorded --data {data} --model nearest --store {tmp_path / 'runs'} --quick"
    assert call(["run", "exp1", *run.split()]) == 0
    assert "simulated sensor recorded" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("driver", "verb", "message"),
    [
        ("ur", "doctor", "all as the configuration says"),
        ("ur", "jog --by 1 0 2", "tool at x 1.000"),
        ("grbl", "calibrate --points 4", "sensor = ["),
        ("grbl", "settle-test --seconds 3", "still within noise"),
    ],
)
def test_a_rehearsed_verb_ends_with_its_own_code(
    driver: str, verb: str, message: str, tmp_path: Path
) -> None:
    """In a process of its own, at 30 frames/s, so that what aborts at its end is seen."""
    if driver == "ur":
        pytest.importorskip("rtde_control", reason="ur_rtde is not installed")
    config = tmp_path / "lab.toml"
    config.write_text(example_configuration(driver), encoding="utf-8")
    command = f"-m tactibench hw {verb} --config {config} --emulate --time-scale 5"
    done = subprocess.run(
        [sys.executable, *command.split()], capture_output=True, text=True, check=False, timeout=300
    )
    assert (done.returncode, done.stderr.splitlines()[1:]) == (0, [])
    assert message in done.stdout


@pytest.mark.slow
def test_a_killed_collection_goes_on() -> None:
    """SIGKILL at random moments; every planned id is there once."""
    script = Path(__file__).parents[2] / "benchmarks" / "hardware.py"
    done = subprocess.run(
        [sys.executable, str(script), "kills", "--kills", "3", "--presses", "20"],
        capture_output=True,
        text=True,
        check=True,
        timeout=580,
    )
    assert "exactly the planned" in done.stdout
    assert "all as it was written" in done.stdout
