"""Failures of plugins: where they happened, and the threads that are left."""

from __future__ import annotations

import inspect
import sys
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from types import FrameType, TracebackType

from tactibench.errors import describe_exception, printable
from tactibench.plugins.discovery import Origin, installed
from tactibench.plugins.host import PluginHost

STUCK_S = 1.0
"""Seconds that a hook may take when it is called again, to find the plugin that owns a module."""


@dataclass(frozen=True)
class Place:
    """The line of a plugin's source that was running.

    Attributes:
        origin: The plugin.
        function: Name of the function.
        file: Path of the source.
        line: Number of the line.
    """

    origin: Origin
    function: str
    file: str
    line: int

    def __str__(self) -> str:
        return printable(f"{self.function} ({self.file}, line {self.line})")


class Owners:
    """The plugins that loaded, by the top-level modules that belong to them."""

    def __init__(self) -> None:
        points = [(point, origin) for point, origin in installed() if point.module in sys.modules]
        host = PluginHost(points, limit_s=STUCK_S)
        self._origins: dict[str, Origin] = {}
        for point, origin in points:
            self._origins.setdefault(_top_level(point.module), origin)
        for catalogue in (*host.catalogues, host.commands):
            for spec in catalogue:
                self._origins.setdefault(_top_level(spec.target), catalogue.origins[spec.name])

    def place_of_error(self, error: BaseException) -> Place | None:
        """Return the innermost line of a plugin that an exception passed; None: it passed none."""
        place = None
        trace: TracebackType | None = error.__traceback__
        while trace is not None:
            place = self._place(trace.tb_frame, trace.tb_lineno) or place
            trace = trace.tb_next
        return place

    def place_of_frame(self, frame: FrameType | None) -> Place | None:
        """Return the innermost line of a plugin on the stack of a frame; None: there is none."""
        while frame is not None:
            place = self._place(frame, frame.f_lineno)
            if place is not None:
                return place
            frame = frame.f_back
        return None

    def _place(self, frame: FrameType, line: int) -> Place | None:
        origin = self._origins.get(_top_level(_module(frame)))
        if origin is None:
            return None
        return Place(origin, frame.f_code.co_qualname, frame.f_code.co_filename, line)


def describe_failure(error: BaseException) -> str | None:
    """Return the sentence about an exception that a plugin raised; None: no plugin raised it.

    The sentence names the plugin, the exception, the file and the line.
    """
    place = Owners().place_of_error(error)
    if place is None:
        return None
    return (
        f"plugin {place.origin} raised {describe_exception(error).rstrip('.')} in {place}; fix or "
        "uninstall it (--debug shows the traceback)."
    )


def describe_method(subject: object, name: str) -> str:
    """Return a method of a plugin's object with its source: ``Net.predict (net.py, line 12)``."""
    kind = type(subject)
    code = getattr(inspect.unwrap(getattr(kind, name)), "__code__", None)
    source = "" if code is None else f" ({code.co_filename}, line {code.co_firstlineno})"
    return printable(f"{kind.__name__}.{name}{source}")


def describe_threads(threads: Iterable[threading.Thread]) -> list[str]:
    """Return a sentence about every thread that is running code of a plugin."""
    owners = Owners()
    frames = sys._current_frames()
    sentences = []
    for thread in threads:
        place = owners.place_of_frame(frames.get(thread.ident or 0))
        if place is not None:
            sentences.append(
                f"plugin {place.origin} left the thread {printable(thread.name)!r} running in "
                f"{place}; it is stopped, and times measured beside it are too long; join it."
            )
    return sentences


def _module(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", ""))


def _top_level(name: str) -> str:
    """Return the package of "package.module" and of "package.module:Class"."""
    return name.partition(":")[0].partition(".")[0]
