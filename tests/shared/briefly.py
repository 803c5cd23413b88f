"""Runs that time their model for a moment: how fast it is does not matter to what is tested."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any


def time_briefly(put: Callable[[Any, str, Any], None]) -> None:
    """Time five calls of one frame and as many batches of one, without a warm-up.

    put: ``setattr``, or that of a patch, which takes it back.
    """
    from tactibench.run import execute as run
    from tactibench.run import timing as speed

    def briefly(
        model: Any, frames: Sequence[Any], answers: Sequence[Any], *_: Any, **more: Any
    ) -> speed.Speed:
        return speed.measure_speed(model, frames, answers, 5, 0.0, **more)

    put(run, "measure_speed", briefly)
    put(speed, "BATCHES", (1,))
