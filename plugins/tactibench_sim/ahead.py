"""Work ahead of a consumer on several threads, in order and not too far."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def cores() -> int:
    """Threads that this process may use: OMP_NUM_THREADS, or else its processors."""
    asked = os.environ.get("OMP_NUM_THREADS", "")
    if asked.isdecimal() and int(asked) > 0:
        return int(asked)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_order(work: Callable[[T], R], items: Iterable[T], threads: int) -> Iterator[R]:
    """``map(work, items)``, at most threads + 1 items ahead of the consumer.

    With one thread nothing is computed before it is asked for. When the consumer stops, what has
    not begun is dropped and what has is waited for. Raises what ``work`` or ``items`` raises.
    """
    if threads == 1:
        yield from map(work, items)
        return
    source = iter(items)
    waiting: deque[Future[R]] = deque()
    pool = ThreadPoolExecutor(threads, thread_name_prefix="tactibench-sim")
    try:
        while True:
            while len(waiting) <= threads:
                try:
                    item = next(source)
                except StopIteration:
                    break
                waiting.append(pool.submit(work, item))
            if not waiting:
                return
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
