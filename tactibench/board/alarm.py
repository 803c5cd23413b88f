"""An alarm that interrupts the code of this process when it takes too long."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Literal

CLOCKS = {"wall": ("ITIMER_REAL", "SIGALRM"), "processor": ("ITIMER_PROF", "SIGPROF")}
"""Clock -> the names of its timer and its signal, which some systems lack."""


@contextmanager
def alarm(
    clock: Literal["wall", "processor"],
    seconds: float,
    stop: Callable[[FrameType | None], None],
    *,
    again_s: float,
) -> Iterator[None]:
    """Call a function inside the block when the time is up, and again until the block ends.

    There is no alarm on systems without such a timer (Windows), beside another alarm of the same
    clock, and outside the main thread, where no signal can be handled. A call into compiled code is
    not interrupted: the alarm comes when it returns.

    Args:
        clock: "processor" counts the time that this process computes, all threads together; a
            machine that is busy with something else does not use it up.
        seconds: How long the block may take, s.
        stop: The function, which raises. It is given the frame that was interrupted.
        again_s: Seconds until the alarm comes again: an exception in a destructor is lost.
    """
    if not hasattr(signal, "setitimer") or threading.current_thread() != threading.main_thread():
        yield
        return
    timer, number = (getattr(signal, name) for name in CLOCKS[clock])
    if signal.getitimer(timer)[0]:
        yield
        return
    before = signal.signal(number, lambda _, frame: stop(frame))
    signal.setitimer(timer, seconds, again_s)
    try:
        yield
    finally:
        signal.setitimer(timer, 0)
        signal.signal(number, before)
