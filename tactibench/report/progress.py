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
from typing import Any

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
        """Show a bar while a model is trained."""
        bar = TrainingBar(self._bar(TextColumn("{task.fields[note]}")))
        try:
            yield bar
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


class TrainingBar:
    """A bar that shows loss, validation error (mm) and time left of a training."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._job: Any = None
        self._steps = 0
        self._note = ""

    def start(self, epochs: int, steps: int) -> None:
        """Begin a training of ``epochs`` epochs of ``steps`` steps."""
        self._steps = steps
        self._progress.start()
        self._job = self._progress.add_task("train", total=epochs * steps, note="")

    def step(self, loss: float) -> None:
        """Show the loss of one more step."""
        if self._job is not None:
            note = f"loss {loss:.4f}{self._note}"
            self._progress.update(self._job, advance=1, note=note)

    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None:
        """Show the loss and the validation error of an epoch."""
        self._note = f"  {_epoch_text(epoch, validation_mm)}"
        if self._job is not None:
            note = f"loss {loss:.4f}{self._note}"
            self._progress.update(self._job, completed=epoch * self._steps, note=note)

    def stop(self) -> None:
        """Remove the bar."""
        if self._job is not None:
            self._progress.stop()


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
            yield TrainingLines(phase, self._clock)

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


class TrainingLines:
    """Steps and epochs of a training, counted in a phase."""

    def __init__(self, phase: Phase, clock: Callable[[], float]) -> None:
        self._phase, self._clock = phase, clock
        self._steps = 0

    def start(self, epochs: int, steps: int) -> None:
        """Begin a training of ``epochs`` epochs of ``steps`` steps."""
        self._steps = steps
        self._phase.began, self._phase.total = self._clock(), epochs * steps

    def step(self, loss: float) -> None:  # noqa: ARG002 - a line shows the loss of an epoch
        """Count a step."""
        self._phase.done += 1

    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None:
        """Keep loss and validation error of an epoch for the next line."""
        done = epoch * self._steps
        # A training that continues after a stop reports earlier epochs without their steps.
        self._phase.before += done - self._phase.done
        self._phase.done = done
        self._phase.note = f"loss {loss:.4f}, {_epoch_text(epoch, validation_mm)}"


def _epoch_text(epoch: int, validation_mm: float | None) -> str:
    error = "" if validation_mm is None else f", validation {validation_mm:.3f} mm"
    return f"epoch {epoch}{error}"
