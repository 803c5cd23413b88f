"""The terminal: progress on stderr, results on stdout, pictures beside the record."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import click
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from tactibench import __version__
from tactibench.errors import printable
from tactibench.plugins import Progress
from tactibench.protocols import Axis
from tactibench.records import RECORD, StoredRun
from tactibench.report import progress_on
from tactibench.shipped import OWN_BOARD, shipped_folder


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
                yield Segment(printable(segment.text, keep="\n\t"), segment.style)


class Terminal:
    """Results on stdout, and progress on stderr: bars, or lines where it is no terminal."""

    def __init__(self) -> None:
        self.out = PlainConsole(soft_wrap=False, highlight=False)
        context = click.get_current_context(silent=True)
        self.quiet = context is not None and bool(context.find_root().params.get("quiet"))
        console = PlainConsole(stderr=True, highlight=False)
        self._progress = progress_on(console, quiet=self.quiet)

    def say(self, line: str) -> None:
        """Print a line, control characters escaped; the terminal breaks it."""
        self.out.print(line, markup=False, soft_wrap=True)

    def say_board(self, board: Path) -> None:
        """Say which board was read where that is none of the user's."""
        if board == shipped_folder("leaderboards"):
            self.say(f"board: that of tactibench {__version__}; rows in {OWN_BOARD} replace it")

    def task(self, title: str, total: int) -> AbstractContextManager[Callable[[int], None]]:
        """Show progress while something of ``total`` steps is done; yields what advances it."""
        return self._progress.task(title, total)

    def training(self) -> AbstractContextManager[Progress]:
        """Show progress while a model is trained."""
        return self._progress.training()


def show_run(
    terminal: Terminal,
    run: StoredRun,
    board: Path,
    *,
    full: bool = False,
    seeds: Sequence[StoredRun] = (),
) -> None:
    """Print a run in about ten lines, or whole, and draw its pictures where it is no quick run.

    Args:
        terminal: Where to print.
        run: That is shown.
        board: Folder of the leaderboards, for the place of the run.
        full: Print all tables and published rows.
        seeds: Runs before it, whose seeds count for its place.
    """
    from tactibench.report import place_line, print_summary

    pictures: list[Path] = []
    place = None
    if not run.record.limits.quick:  # which is on no board, and whose errors show nothing
        from tactibench.board import place_run
        from tactibench.report import update_pictures

        pictures = update_pictures(run)
        place = place_run(run, board, seeds)
    if not full:
        print_summary(terminal.out, run.record, run.folder, place, board)
    else:
        _print_all(terminal, run)
        for picture in pictures:
            terminal.say(f"picture: {picture}")
        terminal.say(place_line(run.record, run.folder, place, board))
    if place is not None:
        terminal.say_board(board)


def _print_all(terminal: Terminal, run: StoredRun) -> None:
    from tactibench.protocols import PublishedTable, published_for, version_of
    from tactibench.report import print_run

    record = run.record
    published: list[PublishedTable] = []
    axes: tuple[Axis, ...] = ()
    protocol = version_of(record.protocol.id, record.protocol.hash)
    if protocol is not None:
        axes = protocol.spec.axes
        recorded = record.sensor.recording
        published = [
            table
            for table in published_for(protocol.spec, shipped_folder("leaderboards/published"))
            if not table.sensor or (recorded is not None and recorded.sensor == table.sensor)
        ]
    print_run(terminal.out, record, run.folder / RECORD, published, axes)
