"""Progress of long work: bars on a terminal, lines in a log.

Where the output is no terminal, such as a log of CI or of a cluster, a line is written after 3
seconds and every 30 that follow: the time, the phase, the share done, and the time left.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from tactibench.plugins import Progress as TrainingProgress
from tactibench.report.tables import duration
from tactibench.run import NullReporter, Reporter

INTERVAL_S = 30.0
"""Time between two lines of long work. The first comes after a tenth of it, so that nobody waits
without knowing for what; shorter work writes no line, so that a log holds results."""


def progress_on(console: Console, *, quiet: bool = False) -> Reporter:
    """Return a reporter for a console: bars on a terminal, else lines; nothing if ``quiet``."""
    if quiet:
        return NullReporter()
    if console.is_terminal:
        return ProgressBars(console)
    return ProgressLines(
        lambda line: console.print(line, markup=False, soft_wrap=True), interval_s=INTERVAL_S
    )


class ProgressBars:
    """Progress as bars that vanish when the work is done."""

    def __init__(self, console: Console) -> None:
        self._console = console

    @contextmanager
    def task(self, title: str, total: int) -> Iterator[Callable[[int], None]]:
        """Show a bar while work of ``total`` steps is done; yields a function that advances it."""
        with self._bar(MofNCompleteColumn()) as progress:
            job = progress.add_task(title, total=total)
            yield lambda done: progress.advance(job, done)

    @contextmanager
    def training(self) -> Iterator[TrainingProgress]:
        """Show a bar with loss and validation error (mm) while a model is trained."""
        bar = self._bar(TextColumn("{task.fields[note]}"))
        job = bar.add_task("train", total=None, note="", start=False)

        def show(steps: Steps) -> None:
            if not bar.live.is_started:
                bar.start_task(job)
                bar.start()
            bar.update(job, total=steps.total, completed=steps.done, note=steps.note)

        try:
            yield Steps(show)
        finally:
            bar.stop()

    def _bar(self, *columns: ProgressColumn) -> Progress:
        return Progress(
            TextColumn("{task.description:<26}"),
            BarColumn(bar_width=24),
            *columns,
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
        )


class Steps:
    """Steps and epochs of a training, counted for whoever shows them.

    Attributes:
        total: Number of steps.
        done: Number of steps that are done.
        before: Number of steps that an earlier part of a continued training did.
        note: Loss of the last step or epoch, and the last epoch with its validation error.
    """

    def __init__(self, show: Callable[[Steps], None]) -> None:
        self._show, self._each = show, 0
        self.total = self.done = self.before = 0
        self.note = self._epoch = ""

    def start(self, epochs: int, steps: int) -> None:
        """Begin a training of ``epochs`` epochs of ``steps`` steps."""
        self._each, self.total = steps, epochs * steps
        self._show(self)

    def step(self, loss: float) -> None:
        """Count a step."""
        self.done += 1
        self._say(loss)

    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None:
        """Keep loss and validation error of an epoch."""
        done = epoch * self._each
        # A training that continues after a stop reports earlier epochs without their steps.
        self.before, self.done = self.before + done - self.done, done
        error = "" if validation_mm is None else f", validation {validation_mm:.3f} mm"
        self._epoch = f", epoch {epoch}{error}"
        self._say(loss)

    def _say(self, loss: float) -> None:
        self.note = f"loss {loss:.4f}{self._epoch}"
        self._show(self)


class ProgressLines:
    """Progress as lines of text while steps are done.

    The first comes after a tenth of ``interval_s`` seconds, the others every ``interval_s``.
    """

    def __init__(
        self,
        write: Callable[[str], None],
        *,
        interval_s: float = INTERVAL_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._write, self._interval_s, self._clock = write, interval_s, clock
        self._due = clock() + interval_s / 10

    @contextmanager
    def task(self, title: str, total: int) -> Iterator[Callable[[int], None]]:
        """Write lines while work of ``total`` steps is done; yields a function that advances it."""
        began, done = self._clock(), 0

        def advance(more: int) -> None:
            nonlocal done
            done += more
            self._write_due(title, began, done, total)

        yield advance

    @contextmanager
    def training(self) -> Iterator[TrainingProgress]:
        """Write lines while a model is trained."""
        began: float | None = None

        def show(steps: Steps) -> None:
            nonlocal began
            began = self._clock() if began is None else began  # opening its frames took no step
            self._write_due("train", began, steps.done, steps.total, steps.before, steps.note)

        yield Steps(show)

    def _write_due(
        self, title: str, began: float, done: int, total: int, before: int = 0, note: str = ""
    ) -> None:
        """Write phase, share done, time so far and time left where the last line is old enough."""
        now = self._clock()
        so_far, fresh = now - began, done - before
        if now < self._due or so_far < self._interval_s / 30:  # too early to tell the time left
            return
        self._due = now + self._interval_s
        text = f"{title}: {done:,} of {total:,} ({done / max(total, 1):.0%}), {duration(so_far)}"
        text += " so far"
        if fresh > 0:
            text += f", {duration(so_far / fresh * (total - done))} left"
        text = f"{text}; {note}" if note else text
        self._write(f"{datetime.now().astimezone():%H:%M:%S} {text}")
