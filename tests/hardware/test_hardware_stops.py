"""docs/hardware.md says how a session can end, and how long one takes: both are tried."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fake_station import TRUE_Z0, write_settings
from virtual_lab import VirtualLab

from tactibench import Indenter, Pose, Scene
from tactibench.cli.main import call
from tactibench.datasets import open_dataset
from tactibench.lab import Press, press_rows
from tactibench_tactip import CollectionPlan

PAGE = (Path(__file__).parents[2] / "docs" / "hardware.md").read_text(encoding="utf-8")
ROWS = {
    cells[0]: cells[1:]
    for line in PAGE.split("| it ends by |")[1].split("\n\n")[0].splitlines()[2:]
    for cells in [[cell.strip() for cell in line.strip("|").split("|")]]
}
"""Reason -> what it says, exit code, what becomes of the press in hand, and of the tool."""
COUNT, TIP = 3, Indenter.single()
IN_PRESS_S = 9.2
"""In the second press."""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> VirtualLab:
    presses = [Press(k, f"p{k}", Scene(TIP, Pose(0.5 * k, depth=3.0)), "s") for k in range(COUNT)]
    return VirtualLab(tmp_path / "data", monkeypatch, CollectionPlan("p", tuple(presses), {}))


def signals(*after_s: float, number: int = signal.SIGINT) -> Callable[[VirtualLab, Any], None]:
    """Send signals in a press."""

    def start(lab: VirtualLab, _: Any) -> None:
        for seconds in after_s:
            lab.later(IN_PRESS_S + seconds, lambda: signal.raise_signal(number))

    return start


def camera(fault: str) -> Callable[[VirtualLab, Any], None]:
    """Let the camera have a fault in a press."""
    return lambda lab, _: lab.later(IN_PRESS_S, lambda: setattr(lab.capture, "fault", fault))


def fill_disk(lab: VirtualLab, patch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    def begin() -> None:
        patch.setattr("tactibench_tactip.collection.Writer.add_many", full)

    lab.later(IN_PRESS_S, begin)


def other_indenter(lab: VirtualLab, _: Any) -> None:
    scene = Scene(Indenter.dual(9.0), Pose(depth=2.0))
    lab.plan = CollectionPlan("p", (*lab.plan.presses, Press(COUNT, "other", scene)), {})


def blind(lab: VirtualLab, _: Any) -> None:
    """Show no press from the second one on, in light that is as it was."""
    lab.later(IN_PRESS_S - 2.0, lambda: setattr(lab.capture, "depth", lambda: 0.0))


def lose_place(lab: VirtualLab) -> None:
    lab.robot.stop()
    lab.robot.unknown = "alarm 1: a limit switch was hit"


def hold(lab: VirtualLab, _: Any = None) -> None:
    """Hold the robot on its way down."""

    def grip() -> None:
        if lab.robot.moving() and lab.robot.depth() > 0.2:
            lab.robot.stop()
        else:
            lab.later(0.03, grip)

    lab.later(IN_PRESS_S, grip)


REASONS: dict[str, Callable[[VirtualLab, Any], None]] = {
    "the last press": lambda *_: None,
    "Ctrl-C": signals(0.0),
    "Ctrl-C twice, SIGTERM": signals(0.0, 0.1),
    "another indenter": other_indenter,
    "camera: frozen, late, slow, cut, another": camera("freeze"),
    "other light": camera("dark"),
    "`give_up` bad presses in a row": blind,
    "a protective stop": lambda lab, _: lab.later(IN_PRESS_S, lambda: lab.robot.protect()),
    "a held robot": hold,
    "a stage's reset or alarm": lambda lab, _: lab.later(IN_PRESS_S, lambda: lose_place(lab)),
    "a lost link": lambda lab, _: lab.later(IN_PRESS_S, lambda: setattr(lab.robot, "lost", True)),
    "a full disk": fill_disk,
}


def test_every_reason_is_tried() -> None:
    assert list(ROWS) == list(REASONS)


@pytest.mark.long
@pytest.mark.parametrize("reason", REASONS)
def test_a_session_ends_as_the_page_says(
    lab: VirtualLab,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    reason: str,
) -> None:
    said, code, press, tool = ROWS[reason]
    REASONS[reason](lab, monkeypatch)
    plan = tmp_path / "plan.jsonl"
    plan.write_text("\n".join(json.dumps(row) for row in press_rows(lab.plan.presses)))
    config = write_settings(tmp_path / "lab.toml", safety={"give_up": 2}, **lab.tables)
    arguments = f"hw collect {plan} --config {config} --out {lab.folder}"
    assert call(arguments.split()) == int(code)
    output = capsys.readouterr()
    assert said in output.err + output.out
    assert "Traceback" not in output.err
    written = [sample.status for sample in open_dataset(lab.folder).samples]
    in_hand = {"written": ["ok"], "bad": ["bad"]}.get(press, [])
    if reason in ("the last press", "another indenter"):
        assert written == ["ok"] * COUNT
    else:
        assert written[1:2] == in_hand
    lab.robot.lost, lab.robot.unknown = False, ""
    lab.robot.pose()
    clear = TRUE_Z0 - lab.settings.envelope.clearance_mm + 0.1
    assert (lab.robot.tool()[2] <= clear) == (tool == "drawn back")
    assert ("left where it is" in output.err) == (tool == "left")
    assert lab.unsafe() == []
    assert lab.wrong_samples() == []


@pytest.mark.long
@pytest.mark.parametrize(
    "command", re.findall(r"tactibench hw collect (exp\d .*) --out data/exp\d", PAGE)
)
def test_times_are_those_of_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    config = tmp_path / "lab.toml"
    assert call(["hw", "example", str(config)]) == 0
    options = command.replace("--config lab.toml", f"--config {config}").split()
    assert call(["hw", "plan", *options]) == 0
    total = re.search(r"([\d,]+) presses of .*; about (.*)", capsys.readouterr().out)
    assert total is not None
    assert f"{total[1]} " in PAGE
    assert total[2] in PAGE


def test_the_page_is_short() -> None:
    assert len(PAGE.split()) <= 1800
