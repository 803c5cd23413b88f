"""Cameras that freeze, lag, shrink and repeat: no sample with a wrong label is called good."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fake_station import FIXED_TOUCH
from virtual_lab import VirtualLab

from tactibench import Indenter, Pose, Scene
from tactibench.lab import Press
from tactibench_tactip import CollectionPlan, matrix, pose_of

DEPTHS = (3.0, 0.8, 1.5, 4.5, 1.0, 2.2)
PLAN = CollectionPlan(
    "drill",
    tuple(
        Press(k, f"p{k}", Scene(Indenter.single(), Pose(0.5 * k, depth=depth)), "singles")
        for k, depth in enumerate(DEPTHS)
    ),
    {},
)
START_S, FIRST_S, MIDDLE_S = 0.0, 6.0, 13.0
"""Before the first frame, in the press that tries the camera, and in a later one."""
FROZEN, RATE = "is frozen: it repeats frames", "new frames a second, camera.fps is 30"
NAMES = {
    ("freeze", START_S): FROZEN,
    ("freeze", FIRST_S): FROZEN,
    ("freeze", MIDDLE_S): FROZEN,
    ("ring", START_S): FROZEN,
    ("ring", MIDDLE_S): FROZEN,
    ("double", START_S): RATE,
    ("double", MIDDLE_S): RATE,
    ("slow", START_S): RATE,
    ("slow", MIDDLE_S): RATE,
    ("half", START_S): RATE,
    ("half", MIDDLE_S): RATE,
    ("mirror", MIDDLE_S): "the exposure changed, or the camera moved",
    ("shrink", MIDDLE_S): "frames of 32 x 32 px, not of 48 x 48 px as before",
    ("dark", MIDDLE_S): "the light or the exposure changed",
    ("hang", MIDDLE_S): "gave no frame for 1 s",
    ("cut", MIDDLE_S): "sends no more frames",
}
"""Fault of the camera and its begin -> part of the sentence that names it."""
FAST = [("shrink", MIDDLE_S)]
VISUAL = {"method": "visual"}
Make = Callable[..., VirtualLab]


def long(rows: Any, fast: Any) -> list[Any]:
    """Mark all rows but a few as long tests."""
    return [row if row in fast else pytest.param(*row, marks=pytest.mark.long) for row in rows]


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    return lambda **tables: VirtualLab(tmp_path / "data", monkeypatch, PLAN, **tables)


@pytest.mark.parametrize(("fault", "at_s"), long(NAMES, FAST))
def test_a_fault_of_the_camera_is_named(make: Make, fault: str, at_s: float) -> None:
    lab = make()
    lab.later(at_s, lambda: setattr(lab.capture, "fault", fault))
    session = lab.session()
    assert NAMES[fault, at_s] in session.said
    assert (lab.wrong_samples(), lab.unsafe(), lab.statuses() <= {"ok"}) == ([], [], True)
    lab.capture.fault = ""
    assert lab.session().report is not None
    assert (lab.wrong_samples(), lab.statuses()) == ([], {"ok"})


def deep(lab: VirtualLab, out: bool) -> bool:
    """Whether the tool moves deep in the skin, out of it or into it."""
    began, ended, start, end = lab.robot.way[-1]
    goes_out = (lab.robot.from_base @ matrix(end))[2, 3] < lab.robot.depth()
    moves = began <= lab.clock.now_s < ended - 0.05 and start != end
    return bool(moves and lab.robot.depth() > 1.0 and goes_out == out)


@pytest.mark.long
@pytest.mark.parametrize("out", [False, True])
@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("protect", "The tool was left where it is. The tool is at"),
        (
            "alarm",
            "alarm 1: a limit switch was hit. The tool was left where it is. Look before",
        ),
        ("lost", "check the cable. The tool was left where it is. Look before anything moves"),
        ("held", "look whether somebody held it. The tool is at"),
    ],
)
def test_a_fault_of_the_robot_in_contact(make: Make, fault: str, told: str, out: bool) -> None:
    """Also in the middle of a retreat. The next session moves straight up first."""
    lab = make()

    def strike() -> None:
        robot = lab.robot
        if not deep(lab, out):
            lab.later(0.03, strike)
            return
        robot.stop()
        robot.normal = robot.stopped = fault != "protect"
        robot.stopped = fault == "protect"
        robot.lost = fault == "lost"
        robot.unknown = "alarm 1: a limit switch was hit" if fault == "alarm" else ""

    lab.later(FIRST_S, strike)
    session = lab.session()
    assert told in session.said
    assert session.said.endswith("in contact.") == (fault != "held")
    lab.robot.unknown = ""
    moves = len(lab.robot.moves_made)
    assert lab.session().report is not None
    first = lab.robot.from_base @ matrix(lab.robot.moves_made[moves])
    assert first[2, 3] < 0.0
    assert (lab.wrong_samples(), lab.unsafe(), lab.statuses()) == ([], [], {"ok"})


def test_a_search_from_a_little_beside_its_place_goes_sideways_high(make: Make) -> None:
    lab = make(contact=VISUAL)
    beside = matrix((0.12, -0.1, -12.0, 0.0, 0.0, 0.0))
    at = pose_of(lab.robot.work @ beside)
    lab.robot.way = [(0.0, 0.0, at, at)]
    assert lab.session().report is not None
    assert lab.robot.sideways
    assert lab.unsafe() == []


LAGS = [
    (lag_s, contact, at_s)
    for lag_s in (0.0, 0.05, 0.1, 0.2, 0.25, 0.3, 0.35, 0.5, 1.0, 2.0, 4.0)
    for contact in (FIXED_TOUCH, VISUAL)
    for at_s in (START_S, MIDDLE_S)
]


@pytest.mark.parametrize(
    ("lag_s", "contact", "at_s"),
    long(LAGS, [(0.25, FIXED_TOUCH, START_S)]),
)
def test_labels_are_right_up_to_a_lag_and_none_are_written_above(
    make: Make, lag_s: float, contact: Any, at_s: float
) -> None:
    """A camera that begins to lag in the middle shows again what it showed before."""
    lab = make(contact=contact)
    lab.later(at_s, lambda: setattr(lab.capture, "lag_s", lag_s))
    session = lab.session()
    assert (lab.wrong_samples(), lab.unsafe()) == ([], [])
    if lag_s <= 0.1:
        assert session.report is not None, session.said
        assert session.report.ok == len(DEPTHS)
    elif at_s == START_S:
        assert (session.report, lab.statuses()) == (None, set())


@pytest.mark.long
@pytest.mark.parametrize("pause_s", [0.15, 0.25, 0.35, 0.5, 0.8])
@pytest.mark.parametrize("at_s", [8.3, 8.6, 8.9, 9.2, 9.5, 9.8, 10.1])
def test_a_stream_that_pauses_and_goes_on_late(make: Make, pause_s: float, at_s: float) -> None:
    lab = make()

    def go_on() -> None:
        lab.capture.fault, lab.capture.lag_s = "", pause_s

    lab.later(at_s, lambda: setattr(lab.capture, "fault", "hang"))
    lab.later(at_s + pause_s, go_on)
    lab.session()
    assert (lab.wrong_samples(), lab.unsafe()) == ([], [])
