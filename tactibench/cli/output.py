"""The terminal: progress on stderr, results on stdout, pictures beside the record."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment

from tactibench.errors import printable
from tactibench.protocols.families import Axis
from tactibench.records.store import RECORD, StoredRun, stored_runs


class PlainConsole(Console):
    """A console whose texts only show themselves: styles are the writer's, never the text's."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterator[Segment]:
        """Yield the segments of something that is printed, control characters escaped."""
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                yield Segment(printable(segment.text), segment.style)


class Terminal:
    """Results on stdout, and progress on stderr, which is silent where it is no terminal."""

    def __init__(self) -> None:
        self.out = PlainConsole(soft_wrap=False, highlight=False)
        self.err = PlainConsole(stderr=True, highlight=False)

    def say(self, line: str) -> None:
        """Print a line as it is; the terminal breaks it."""
        self.out.print(line, markup=False, soft_wrap=True)

    @contextmanager
    def task(self, title: str, total: int) -> Iterator[Callable[[int], None]]:
        """Show a bar while something of ``total`` steps is done; yields what advances it."""
        with self._progress(MofNCompleteColumn()) as progress:
            job = progress.add_task(title, total=total)
            yield lambda done: progress.advance(job, done)

    @contextmanager
    def training(self) -> Iterator[TrainingBar]:
        """Show a bar while a model is trained."""
        bar = TrainingBar(self._progress(TextColumn("{task.fields[note]}")))
        try:
            yield bar
        finally:
            bar.stop()

    def _progress(self, *columns: ProgressColumn) -> Progress:
        return Progress(
            TextColumn("{task.description:<26}"),
            BarColumn(bar_width=24),
            *columns,
            TimeRemainingColumn(),
            console=self.err,
            transient=True,
            disable=not self.err.is_terminal,
        )


class TrainingBar:
    """A bar with loss, validation error in mm and time left of a training."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._job: Any = None
        self._steps = 0
        self._note = ""

    def start(self, epochs: int, steps: int) -> None:
        """Begin with so many epochs of so many steps."""
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
        error = "" if validation_mm is None else f"  validation {validation_mm:.3f} mm"
        self._note = f"  epoch {epoch}{error}"
        if self._job is not None:
            note = f"loss {loss:.4f}{self._note}"
            self._progress.update(self._job, completed=epoch * self._steps, note=note)

    def stop(self) -> None:
        """Take the bar away."""
        if self._job is not None:
            self._progress.stop()


def show_run(terminal: Terminal, run: StoredRun, store: Path) -> None:
    """Print the result beside the published numbers, and its pictures."""
    from tactibench.protocols.loader import version_of
    from tactibench.protocols.published import PublishedTable, published_for
    from tactibench.report.plots.run_pictures import update_pictures
    from tactibench.report.run_report import print_run
    from tactibench.shipped import shipped_folder

    record = run.record
    others = [other for other in stored_runs(store) if other.folder.name != run.folder.name]
    published: list[PublishedTable] = []
    axes: tuple[Axis, ...] = ()
    protocol = version_of(record.protocol.id, record.protocol.hash)
    if protocol is not None:
        axes = protocol.spec.axes
        recorded = record.sensor.recording
        published = [
            table
            for table in published_for(protocol.spec, shipped_folder("published"))
            if not table.sensor or (recorded is not None and recorded.sensor == table.sensor)
        ]
    records = [other.record for other in others]
    print_run(terminal.out, record, run.folder / RECORD, published, records, axes)
    for picture in update_pictures(run, others):
        terminal.say(f"picture: {picture}")
    terminal.say("terms: docs/glossary.md")
