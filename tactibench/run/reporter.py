"""Progress of long work, and reporters of work that nobody watches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from tactibench.plugins.base import Progress


class Reporter(Protocol):
    """Shows long work. ``task`` gives a function that is told of finished items."""

    def task(self, title: str, total: int) -> AbstractContextManager[Callable[[int], None]]: ...

    def training(self) -> AbstractContextManager[Progress]: ...


class NullProgress:
    """A training that shows nothing."""

    def start(self, epochs: int, steps: int) -> None: ...

    def step(self, loss: float) -> None: ...

    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None: ...


class NullReporter:
    """A reporter that shows nothing."""

    @contextmanager
    def task(self, title: str, total: int) -> Iterator[Callable[[int], None]]:  # noqa: ARG002
        yield lambda _: None

    @contextmanager
    def training(self) -> Iterator[Progress]:
        yield NullProgress()
