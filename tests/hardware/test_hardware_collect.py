"""A collection: what is written, what is resumed, what is refused."""

from __future__ import annotations

import signal
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from fake_station import (
    FIXED_TOUCH,
    TRUE_Z0,
    FakeCapture,
    FakeRobot,
    make_settings,
    stand_in,
)

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import open_dataset, verify
from tactibench.lab import Press
from tactibench_tactip import (
    Callbacks,
    CollectionPlan,
    ProtectiveStopError,
    SessionReport,
    Settings,
    StopNowError,
    collect,
    dry_run,
    inverse,
    matrix,
    pose_of,
)

COUNT = 4
TRIAL = 4
"""Moves of the press that tries the camera before the first one."""


def plan(count: int = COUNT, indenter: Indenter | None = None) -> CollectionPlan:
    single = Indenter.single()
    presses = [
        Press(k, f"p{k}", Scene(single, Pose(0.5 * k, -0.3 * k, depth=2.0 + 0.5 * k)), "singles")
        for k in range(count)
    ]
    if indenter is not None:
        presses.append(Press(count, "other", Scene(indenter, Pose(depth=2.0)), "others"))
    return CollectionPlan(
        "test", tuple(presses), {"half": {"train": [0, 1], "validation": [2], "test": [3]}}
    )


class Lab:
    """Collects with fakes; every session has a robot of its own."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder = folder
        self.settings = make_settings(contact=FIXED_TOUCH)
        self.robot = FakeRobot(self.settings)
        self.capture = FakeCapture(self.robot)
        self.said: list[str] = []
        stand_in(self._new_robot, monkeypatch)
        self.prepare: Callable[[FakeRobot], None] = lambda _: None

    def _new_robot(self, settings: Settings) -> FakeRobot:
        self.robot = FakeRobot(settings)
        self.robot.capture, self.capture.robot = self.capture, self.robot
        self.prepare(self.robot)
        return self.robot

    def collect(self, what: CollectionPlan | None = None, **more: Any) -> SessionReport:
        callbacks = Callbacks(notify=self.said.append, **more)
        return collect(self.settings, what or plan(), self.folder, callbacks=callbacks)

    def collect_until_a_failure(self) -> None:
        self.prepare = lambda robot: setattr(robot, "fails", _raiser(RuntimeError("x"), TRIAL + 6))
        with pytest.raises(RuntimeError):
            self.collect()
        self.prepare = lambda _: None

    def ids(self) -> list[int]:
        return [sample.id for sample in open_dataset(self.folder).samples]


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Lab:
    return Lab(tmp_path / "data", monkeypatch)


def test_every_press_is_written_with_what_was_reached(lab: Lab) -> None:
    report = lab.collect()
    assert (report.ok, report.bad, report.left) == (COUNT, 0, 0)
    dataset = open_dataset(lab.folder)
    assert dataset.header.status == "closed"
    assert verify(lab.folder) == []
    for sample, press in zip(dataset.samples, plan().presses, strict=True):
        assert sample.scene is not None
        assert sample.scene.pose.depth == pytest.approx(press.scene.pose.depth, abs=1e-6)
        assert sample.scene.pose.x == pytest.approx(press.scene.pose.x, abs=1e-6)
        assert sample.t_frame_ns is not None
        assert sample.t_frame_ns > sample.extra["t_settle_ns"]
        assert sample.extra["z0_mm"] == TRUE_Z0
    assert dataset.rest is not None
    assert list(dataset.splits) == ["half"]
    assert {event["kind"] for event in dataset.events} == {"session", "reference", "touch"}


def test_the_tool_is_never_moved_sideways_below_clearance(lab: Lab) -> None:
    lab.collect()
    robot = lab.robot
    work = [pose_of(inverse(robot.work) @ matrix(pose)) for pose in robot.moves]
    clear = TRUE_Z0 - lab.settings.envelope.clearance_mm + 0.01
    for before, after in pairwise(work):
        if max(abs(a - b) for a, b in zip(before[:2], after[:2], strict=True)) > 1e-6:
            assert max(before[2], after[2]) <= clear


def test_a_complete_data_set_moves_nothing(lab: Lab) -> None:
    lab.collect()
    moves = len(lab.robot.moves)
    assert lab.collect().left == 0
    assert len(lab.robot.moves) == moves
    with pytest.raises(UserError, match="is closed"):
        lab.collect(plan(COUNT - 1))
    assert lab.robot.moves == []


def test_an_interrupted_session_goes_on(lab: Lab) -> None:
    journal = lab.folder / "metadata.jsonl"

    def fail(_: int) -> None:
        if journal.exists() and len(journal.read_bytes().splitlines()) == 2:
            raise KeyboardInterrupt

    def prepare(robot: FakeRobot) -> None:
        robot.fails = fail

    lab.prepare = prepare
    with pytest.raises(KeyboardInterrupt):
        lab.collect()
    assert lab.ids() == [0, 1]
    lab.prepare = lambda _: None
    assert lab.collect().ok == 2
    assert lab.ids() == [0, 1, 2, 3]


def test_other_settings_are_refused_before_the_robot_moves(lab: Lab) -> None:
    lab.collect_until_a_failure()
    lab.settings = make_settings(contact={"method": "fixed", "fixed_mm": 0.5})
    with pytest.raises(UserError, match=r"fixed_mm 0\.35, now it is 0\.5"):
        lab.collect()
    assert lab.robot.moves == []


def test_a_rehearsal_does_not_go_on_with_a_data_set(lab: Lab) -> None:
    lab.collect_until_a_failure()
    lab.settings = lab.settings.with_changes(robot={"address": "simulated"})
    with pytest.raises(UserError, match="origin"):
        lab.collect()


def test_a_sensor_that_looks_otherwise_is_refused(lab: Lab) -> None:
    lab.collect_until_a_failure()
    lab.capture.rest = lab.capture.rest[:, ::-1] + 8.0
    with pytest.raises(UserError, match="grey levels from the first one of"):
        lab.collect()


def test_a_press_that_stops_the_arm_twice_is_given_up(lab: Lab) -> None:
    for _ in range(2):
        lab.prepare = lambda robot: setattr(robot, "fails", _stopper(robot, TRIAL + 3))
        with pytest.raises(ProtectiveStopError, match=r"at press 0\. Look at the arm"):
            lab.collect()
    lab.prepare = lambda _: None
    assert lab.collect().left == 0
    events = open_dataset(lab.folder).events
    assert sum(event["kind"] == "protective-stop" for event in events) == 2
    samples = {sample.id: sample for sample in open_dataset(lab.folder).samples}
    assert sorted(samples) == [0, 1, 2, 3]
    assert [samples[k].status for k in range(4)] == ["bad", "ok", "ok", "ok"]
    assert samples[0].extra["outcome"] == "aborted"


def test_bad_frames_are_tried_again_and_then_marked(lab: Lab) -> None:
    def blind(number: int) -> None:
        if number == TRIAL + 1:  # no press can be seen from the first one on
            lab.capture.pattern = 0.0 * lab.capture.pattern

    lab.prepare = lambda robot: setattr(robot, "fails", blind)
    lab.settings = make_settings(contact=FIXED_TOUCH, safety={"give_up": 3})
    with pytest.raises(UserError, match=r"3 presses in a row were bad.*no contact is seen"):
        lab.collect()
    dataset = open_dataset(lab.folder)
    assert [sample.status for sample in dataset.samples] == ["bad"] * 3
    assert all(sample.attempt == 2 for sample in dataset.samples)


@pytest.mark.long
def test_a_fault_of_the_whole_setup_writes_no_press(lab: Lab) -> None:
    """Nothing would make the press again that was written as bad for it."""
    capture, steady = lab.capture, lab.capture.retrieve

    def spoil(number: int) -> None:
        if number == TRIAL + 6:  # in the second press
            capture.retrieve = lambda: (True, 0 * steady()[1])  # type: ignore[method-assign]

    lab.prepare = lambda robot: setattr(robot, "fails", spoil)
    with pytest.raises(UserError, match=r"frozen.*sees light"):
        lab.collect()
    written = open_dataset(lab.folder).samples
    assert [sample.status for sample in written] == ["ok"] * len(written)
    assert len(written) < COUNT
    lab.prepare = lambda _: None
    capture.retrieve = steady  # type: ignore[method-assign]
    assert lab.collect().left == 0
    assert [sample.status for sample in open_dataset(lab.folder).samples] == ["ok"] * COUNT


class Sticking(FakeCapture):
    """Shows a press for so many frames after it is gone."""

    frames, left, last = 0, 0, 0.0

    def depth(self) -> float:
        depth = super().depth()
        if depth > 0.0:
            self.left, self.last = self.frames, depth
        elif self.left > 0:
            self.left -= 1
            return self.last
        return depth


def test_a_press_waits_until_the_one_before_is_gone(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactibench_tactip.station.RELAXING_S", 60.0)  # on a busy machine, too
    sticking = Sticking(lab.robot)
    lab.capture = sticking
    begun: list[int] = []  # frames left, at every move of a tool that touches nothing

    def look(number: int) -> None:
        sticking.frames = 250 if number > TRIAL else 0
        if lab.robot.depth() == 0.0:
            begun.append(sticking.left)

    lab.prepare = lambda robot: setattr(robot, "fails", look)
    lab.settings = make_settings(contact=FIXED_TOUCH, safety={"give_up": 9})
    assert lab.collect().bad == COUNT
    samples = open_dataset(lab.folder).samples
    assert all("still shows a contact" in sample.extra["reason"] for sample in samples)
    assert set(begun) == {0}


def test_a_camera_that_lags_for_good_ends_the_session(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactibench_tactip.station.RELAXING_S", 0.05)
    sticking = lab.capture = Sticking(lab.robot)

    def stick(number: int) -> None:
        sticking.frames = 10**9 * (number > TRIAL)

    lab.prepare = lambda robot: setattr(robot, "fails", stick)
    with pytest.raises(UserError, match=r"still show a contact .* the camera lags"):
        lab.collect()
    assert lab.ids() == []


def test_an_indenter_that_is_not_mounted_waits(lab: Lab) -> None:
    what = plan(indenter=Indenter.dual(9.0))
    report = lab.collect(what)
    assert (report.ok, report.left) == (COUNT, 1)
    assert open_dataset(lab.folder).header.status == "open"
    asked: list[Indenter] = []

    def mount(indenter: Indenter, count: int) -> bool:
        asked.append(indenter)
        assert count == 1
        assert lab.robot.tool()[2] < -40.0  # room for hands
        return True

    assert lab.collect(what, mount=mount).left == 0
    assert asked == [Indenter.dual(9.0)]
    assert open_dataset(lab.folder).header.status == "closed"


def test_nobody_is_asked_for_an_indenter_after_an_interrupt(lab: Lab) -> None:
    def interrupt(count: int) -> None:
        if count and lab.ids()[-1:] == [COUNT - 1]:
            signal.raise_signal(signal.SIGINT)

    what = plan(indenter=Indenter.dual(9.0))
    report = lab.collect(what, advance=interrupt, mount=lambda *_: pytest.fail("asked"))
    assert (report.ok, report.left, report.interrupted) == (COUNT, 1, True)

    def leave(*_: object) -> bool:
        raise StopNowError

    report = lab.collect(what, mount=leave)
    assert (report.left, report.interrupted) == (1, True)
    assert "clear of the sensor" in lab.said[-1]


def test_first_touch_is_found_again_with_another_indenter(lab: Lab) -> None:
    assert lab.collect(plan(indenter=Indenter.dual(9.0)), mount=lambda *_: True).left == 0
    kinds = [event["kind"] for event in open_dataset(lab.folder).events]
    assert kinds.count("touch") == 2


def test_the_plan_is_checked_again_from_first_touch(lab: Lab) -> None:
    """It lies deeper than the configuration says."""
    lab.settings = make_settings(envelope={"below_mm": 2.0 + TRUE_Z0 / 2})
    with pytest.raises(UserError, match=r"1 of 1 presses .*refused"):
        lab.collect(plan(1))


def test_a_full_disk_leaves_the_tool_high(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tactibench_tactip.collection.Writer.add_many", full)
    with pytest.raises(OSError, match="No space left"):
        lab.collect()
    assert lab.robot.tool()[2] <= TRUE_Z0 - lab.settings.envelope.clearance_mm + 0.1
    assert lab.robot.closed


def test_a_flickering_light_is_refused(lab: Lab) -> None:
    grabs = iter(range(10_000))
    steady = lab.capture.retrieve

    def brighter() -> tuple[bool, Any]:
        good, image = steady()
        return good, (image * (0.6 + 0.004 * min(next(grabs), 90))).astype(image.dtype)

    lab.capture.retrieve = brighter  # type: ignore[method-assign]
    with pytest.raises(UserError, match="automatic exposure off"):
        lab.collect()
    assert lab.robot.moves == []


def test_a_dry_run_stays_high_and_keeps_nothing(lab: Lab) -> None:
    assert dry_run(lab.settings, plan().presses, 20.0, Callbacks(lab.said.append)) == COUNT
    assert "mm before first touch, clear of the sensor" in lab.said[-1]
    heights = [(inverse(lab.robot.work) @ matrix(pose))[2, 3] for pose in lab.robot.moves]
    assert max(heights) < -15.0
    assert not lab.folder.exists()
    with pytest.raises(UserError, match="dry-run-height"):
        dry_run(lab.settings, plan().presses, 55.0, Callbacks())


def _raiser(error: Exception, at: int) -> Callable[[int], None]:
    def fail(number: int) -> None:
        if number == at:
            raise error

    return fail


def _stopper(robot: FakeRobot, at: int) -> Callable[[int], None]:
    def stop(number: int) -> None:
        if number == at:
            robot.normal, robot.stopped = False, True

    return stop
