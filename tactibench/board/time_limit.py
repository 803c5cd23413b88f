"""A limit of processor time, which a machine that is busy with something else does not use up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from tactibench.errors import UserError

AGAIN_S = 0.5
"""Processor time until the limit is said again: what is raised where Python cannot let it through,
as in a destructor, is lost."""


class _OutOfTimeError(BaseException):
    """The time is up; no handler of errors takes it for one of its own."""


@contextmanager
def processor_time(limit_s: float, sentence: str) -> Iterator[None]:
    """Stop what is done within after so much processor time of this process.

    There is no limit where the system has no such timer (Windows), nor outside the main thread.

    Args:
        limit_s: seconds of all threads together.
        sentence: of the error.

    Raises:
        UserError: when the time is up; a call into compiled code ends before.
    """
    main = threading.current_thread() is threading.main_thread()
    if not main or not hasattr(signal, "setitimer"):
        yield
        return
    before = signal.signal(signal.SIGPROF, _stop)
    signal.setitimer(signal.ITIMER_PROF, limit_s, AGAIN_S)
    try:
        yield
    except _OutOfTimeError:
        raise UserError(sentence) from None
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def _stop(_number: int, _frame: FrameType | None) -> None:
    raise _OutOfTimeError
