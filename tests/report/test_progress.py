"""Progress where there is no terminal: a line after 3 s and every 30 s."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from stored_answers import answered_parts, store_run

from tactibench.api import compare
from tactibench.records import Record, run_names
from tactibench.report import (
    ProgressBars,
    ProgressLines,
    gather,
    progress_on,
    report_page,
    site_pages,
)
from tactibench.run import NullReporter


class Clock:
    """Seconds that pass when the test says so."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_lines_tell_phase_share_and_time_left_after_3_s_and_every_30_s() -> None:
    clock, lines = Clock(), []
    progress = ProgressLines(lambda line: lines.append(line.split(" ", 1)[1]), clock=clock)
    with progress.task("predict", 2000) as advance:
        clock.now = 2.0
        advance(250)
        clock.now = 3.2
        with progress.task("a short one that begins late", 2) as short:
            clock.now = 3.5
            short(1)
        clock.now = 4.0
        advance(250)
        clock.now = 33.0
        advance(500)
        clock.now = 60.0
        advance(500)
        clock.now = 61.0
        advance(500)
    with progress.training() as training:
        training.start(epochs=10, steps=4)
        for epoch in range(1, 6):  # of a training that was interrupted
            training.epoch(epoch, 0.1, 0.125)
        clock.now = 91.0
        for _ in range(4):
            training.step(0.1)
    assert lines == [
        "predict: 500 of 2,000 (25%), 4.0 s so far, 12 s left",
        "predict: 1,500 of 2,000 (75%), 1 min 0 s so far, 20 s left",
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


class Count(NullReporter):
    """A reporter that holds how much of the last task was announced, and how much was done."""

    total = done = 0

    @contextmanager
    def task(self, title: str, total: int) -> Iterator[Callable[[int], None]]:
        self.total, self.done = total, 0
        yield self._advance

    def _advance(self, more: int) -> None:
        self.done += more


def test_a_comparison_and_a_report_do_as_many_steps_as_they_announce(
    tmp_path: Path, fabricate: Callable[..., Record]
) -> None:
    for model, offset in (("cnn", 0.05), ("unet", 0.1), ("vgnn", 0.2)):
        store_run(tmp_path, fabricate(model=model), answered_parts(offset))
    shown = Count()
    compare(*run_names(tmp_path), store=tmp_path, progress=shown)
    assert (shown.done, shown.total) == (6, 6)  # three runs and three pairs
    steps: list[int] = []
    data = gather(tmp_path, None)
    report_page(data, advance=steps.append)
    assert sum(steps) == 2 * len(data.boards)
    steps.clear()
    assert len(list(site_pages(data, advance=steps.append))) == 1 + len(data.boards)
    assert sum(steps) == 2 * len(data.boards)
