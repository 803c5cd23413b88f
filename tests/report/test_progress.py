"""Progress where there is no terminal: a line every 30 s, and silence before."""

from __future__ import annotations

import io

from rich.console import Console

from tactibench.report import ProgressBars, ProgressLines, progress_on
from tactibench.run import NullReporter


class Clock:
    """Seconds that pass when the test says so."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_lines_tell_phase_share_and_time_left_every_30_s() -> None:
    clock, lines = Clock(), []
    progress = ProgressLines(lambda line: lines.append(line.split(" ", 1)[1]), clock=clock)
    with progress.task("predict", 2000) as advance:
        clock.now = 29.0
        advance(250)
        clock.now = 40.0
        advance(250)
        clock.now = 69.0
        advance(500)
        clock.now = 70.0
        advance(500)
    with progress.training() as training:
        training.start(epochs=10, steps=4)
        for epoch in range(1, 6):  # of a training that was interrupted
            training.epoch(epoch, 0.1, 0.125)
        clock.now = 100.0
        for _ in range(4):
            training.step(0.1)
    assert lines == [
        "predict: 500 of 2,000 (25%), 40 s so far, 2 min 0 s left",
        "predict: 1,500 of 2,000 (75%), 1 min 10 s so far, 23 s left",
        "train: 21 of 40 (52%), 30 s so far, 9 min 30 s left; "
        "loss 0.1000, epoch 5, validation 0.125 mm",
    ]


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
