"""Progress of long work: bars on a terminal, lines in a log.

Where the output is no terminal, such as a log of CI or of a cluster, a line is written at least
every 30 seconds: the time, the phase, the share done, and the time left.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
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
from tactibench.report.labels import duration
from tactibench.run import NullReporter, Reporter

INTERVAL_S = 30.0
"""Longest silence of long work. Shorter work writes no line, so that a log holds results."""


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


@dataclass
class Phase:
    """A part of the work that is being done.

    Attributes:
        title: Name of the phase.
        total: Number of its steps.
        began: Time at which it began, s.
        done: Number of steps that are done.
        before: Number of steps that were done before it began, where a training is continued.
        note: Further words for the line.
    """

    title: str
    total: int
    began: float
    done: int = 0
    before: int = 0
    note: str = ""

    def line(self, now: float) -> str:
        """Return phase, share done, time so far, and time left where that is known.

        Args:
            now: Present time on the clock of ``began``, s.
        """
        so_far = now - self.began
        progress, done = duration(so_far), self.done - self.before
        if self.total:
            progress = f"{self.done:,} of {self.total:,} ({self.done / self.total:.0%}), {progress}"
        left = "time left not known"
        if done > 0:
            left = f"{duration(so_far / done * (self.total - self.done))} left"
        text = f"{self.title}: {progress} so far, {left}"
        return f"{text}; {self.note}" if self.note else text


class ProgressLines:
    """Progress as lines of text, at least one every ``interval_s`` seconds while there is work.

    A thread writes them, because one step may take longer than that. It sleeps in between, so
    that it does not disturb timed work.
    """

    def __init__(
        self,
        write: Callable[[str], None],
        *,
        interval_s: float = INTERVAL_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._write, self._interval_s, self._clock = write, interval_s, clock
        self._phases: list[Phase] = []
        self._last = clock()
        self._lock = threading.Lock()

    @contextmanager
    def task(self, title: str, total: int) -> Iterator[Callable[[int], None]]:
        """Write lines while work of ``total`` steps is done; yields a function that advances it."""
        with self._during(title, total) as phase:

            def advance(done: int) -> None:
                phase.done += done

            yield advance

    @contextmanager
    def training(self) -> Iterator[TrainingProgress]:
        """Write lines while a model is trained; opening its frames is a phase of its own."""
        with self._during("train", 0) as phase:

            def show(steps: Steps) -> None:
                if phase.total != steps.total:
                    phase.began, phase.total = self._clock(), steps.total
                phase.done, phase.before, phase.note = steps.done, steps.before, steps.note

            yield Steps(show)

    def write_due(self) -> None:
        """Write a line where the last one is old enough; of nested phases on the inner one."""
        with self._lock:
            now = self._clock()
            if not self._phases or now - self._last < self._interval_s:
                return
            phase, self._last = self._phases[-1], now
        self._write(f"{datetime.now().astimezone():%H:%M:%S} {phase.line(now)}")

    @contextmanager
    def _during(self, title: str, total: int) -> Iterator[Phase]:
        phase = Phase(title, total, self._clock())
        over = threading.Event()
        with self._lock:
            self._phases.append(phase)
            outermost = len(self._phases) == 1
        ticker = threading.Thread(target=self._tick, args=(over,), daemon=True)
        if outermost:
            ticker.start()
        try:
            yield phase
        finally:
            with self._lock:
                self._phases.remove(phase)
            over.set()
            if outermost:
                ticker.join()

    def _tick(self, over: threading.Event) -> None:
        while not over.wait(max(self._last + self._interval_s - self._clock(), 0.0)):
            self.write_due()
