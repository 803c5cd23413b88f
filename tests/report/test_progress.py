"""Progress where there is no terminal: a line at least every 30 s, and silence before."""

from __future__ import annotations

import io
import threading

import pytest
from rich.console import Console

from tactibench.report import INTERVAL_S, ProgressBars, ProgressLines, progress_on
from tactibench.run import NullReporter


class Clock:
    """Seconds that pass when the test says so."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def lines() -> list[str]:
    """What was written, without the time of day."""
    return []


@pytest.fixture
def progress(lines: list[str], clock: Clock, monkeypatch: pytest.MonkeyPatch) -> ProgressLines:
    """Lines on the test's clock; the thread that writes them does nothing."""
    monkeypatch.setattr(ProgressLines, "_tick", lambda *_: None)
    return ProgressLines(lambda line: lines.append(line.split(" ", 1)[1]), clock=clock)


def test_short_work_says_nothing(progress: ProgressLines, clock: Clock, lines: list[str]) -> None:
    with progress.task("predict", 100) as advance:
        advance(50)
        clock.now = INTERVAL_S - 1
        progress.write_due()
    assert lines == []


def test_a_line_has_phase_share_and_time_left(
    progress: ProgressLines, clock: Clock, lines: list[str]
) -> None:
    with progress.task("predict", 2000) as advance:
        advance(500)
        clock.now = 40.0
        progress.write_due()
        progress.write_due()  # the next one is due 30 s later
        advance(1000)
        clock.now = 70.0
        progress.write_due()
    assert lines == [
        "predict: 500 of 2,000 (25%), 40 s so far, 2 min 0 s left",
        "predict: 1,500 of 2,000 (75%), 1 min 10 s so far, 23 s left",
    ]


def test_phases_share_the_thirty_seconds(
    progress: ProgressLines, clock: Clock, lines: list[str]
) -> None:
    for number in range(4):
        with progress.task(f"set {number}", 1):
            clock.now += 12.0
            progress.write_due()
    assert lines == ["set 2: 0 of 1 (0%), 12 s so far, time left not known"]


def test_frames_that_a_training_opens_are_told_before_its_steps(
    progress: ProgressLines, clock: Clock, lines: list[str]
) -> None:
    with progress.training() as training:
        with progress.task("generate singles (fit)", 10) as advance:
            advance(5)
            clock.now = 30.0
            progress.write_due()
        clock.now = 60.0
        progress.write_due()
        training.start(epochs=10, steps=4)
        for _ in range(4):
            training.step(0.5)
        training.epoch(1, 0.25, 0.125)
        clock.now = 90.0
        progress.write_due()
    assert lines == [
        "generate singles (fit): 5 of 10 (50%), 30 s so far, 30 s left",
        "train: 1 min 0 s so far, time left not known",
        "train: 4 of 40 (10%), 30 s so far, 4 min 30 s left; "
        "loss 0.2500, epoch 1, validation 0.125 mm",
    ]


def test_epochs_before_an_interruption_took_no_time_now(
    progress: ProgressLines, clock: Clock, lines: list[str]
) -> None:
    with progress.training() as training:
        training.start(epochs=10, steps=4)
        for epoch in range(1, 6):
            training.epoch(epoch, 0.1, None)
        for _ in range(4):
            training.step(0.1)
        clock.now = 30.0
        progress.write_due()
    assert lines == ["train: 24 of 40 (60%), 30 s so far, 2 min 0 s left; loss 0.1000, epoch 5"]


def test_a_thread_writes_while_one_step_takes_long() -> None:
    written = threading.Event()
    progress = ProgressLines(lambda _: written.set(), interval_s=0.01)
    with progress.task("one long step", 1):
        assert written.wait(timeout=30)
    assert threading.active_count() == 1 or not any(
        "_tick" in thread.name for thread in threading.enumerate()
    )


def test_where_it_is_shown() -> None:
    log = Console(file=io.StringIO(), force_terminal=False)
    assert isinstance(progress_on(log), ProgressLines)
    assert isinstance(progress_on(log, quiet=True), NullReporter)
    terminal = Console(file=io.StringIO(), force_terminal=True)
    assert isinstance(progress_on(terminal), ProgressBars)
    with progress_on(terminal).task("bar", 2) as advance:
        advance(1)
    with progress_on(terminal).training() as training:
        training.start(1, 1)
        training.step(0.1)
        training.epoch(1, 0.1, 0.2)
