"""Runs that time their model for a moment: how fast it is does not matter to what is tested."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def time_briefly(put: Callable[[Any, str, Any], None]) -> None:
    """Time five calls of one frame and as many batches of one, without a warm-up.

    put: ``setattr``, or that of a patch, which takes it back.
    """
    from tactibench.run import timing

    for name, value in (("CALLS", 5), ("BUDGET_S", 0.0), ("BATCHES", (1,))):
        put(timing, name, value)
    for name, value in (("QUICK_CALLS", 5), ("QUICK_BUDGET_S", 0.0)):
        put(timing, name, value)
