"""Reporters of work that nobody watches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tactibench.plugins.base import Progress


class SilentProgress:
    """A training that shows nothing."""

    def start(self, epochs: int, steps: int) -> None: ...

    def step(self, loss: float) -> None: ...

    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None: ...


class Silent:
    """A reporter that shows nothing."""

    @contextmanager
    def task(self, title: str, total: int) -> Iterator[Callable[[int], None]]:  # noqa: ARG002
        yield lambda _: None

    @contextmanager
    def training(self) -> Iterator[Progress]:
        yield SilentProgress()
