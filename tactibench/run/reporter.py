"""Progress of long work, and reporters that show nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from tactibench.frames import FrameSet, Presses
from tactibench.plugins import Progress


class Reporter(Protocol):
    """A display of long work."""

    def task(self, title: str, total: int) -> AbstractContextManager[Callable[[int], None]]:
        """Show a task of ``total`` items; the function is called with numbers of finished items."""
        ...

    def training(self) -> AbstractContextManager[Progress]:
        """Show a training."""
        ...


class NullProgress:
    """A training that shows nothing."""

    def start(self, epochs: int, steps: int) -> None:
        """Ignore the beginning."""

    def step(self, loss: float) -> None:
        """Ignore a step."""

    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None:
        """Ignore an epoch."""


class NullReporter:
    """A reporter that shows nothing."""

    @contextmanager
    def task(self, title: str, total: int) -> Iterator[Callable[[int], None]]:  # noqa: ARG002
        """Show nothing."""
        yield lambda _: None

    @contextmanager
    def training(self) -> Iterator[Progress]:
        """Show nothing."""
        yield NullProgress()


def open_frames(frames: FrameSet, reporter: Reporter) -> Presses:
    """Return the frames of one set, made where they are not in the cache."""
    verb = "open" if frames.cached else "generate"
    with reporter.task(f"{verb} {frames.name} ({frames.role})", len(frames.scenes)) as advance:
        return frames.open(advance)
