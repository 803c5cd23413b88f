"""A device of the emulators: a context manager with threads that end within a deadline."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from threading import Event, Thread
from typing import Self

DEADLINE_S = 5.0
"""Host seconds within which a device has stopped."""


class Device(ABC):
    """Something to ``start`` and ``stop``; both may be called again."""

    def __init__(self) -> None:
        self.stopping = Event()
        self._threads: list[Thread] = []

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @abstractmethod
    def start(self) -> None:
        """Open the device."""

    @abstractmethod
    def close(self) -> None:
        """Close what is open, so that every thread comes to an end."""

    def stop(self) -> None:
        """Close and join the threads. Raises RuntimeError where one does not end."""
        self.stopping.set()
        self.close()
        for thread in self._threads:
            thread.join(DEADLINE_S)
        left = [thread.name for thread in self._threads if thread.is_alive()]
        self._threads.clear()
        self.stopping.clear()
        if left:
            raise RuntimeError(f"threads did not end within {DEADLINE_S:g} s: {', '.join(left)}")

    def run(self, name: str, target: Callable[..., None], *arguments: object) -> None:
        """Run a callable on a thread of the device."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = Thread(target=target, args=arguments, name=name, daemon=True)
        self._threads.append(thread)
        thread.start()
