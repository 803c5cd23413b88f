"""The world's time: the host's monotonic clock times a scale."""

from __future__ import annotations

import math
import time

from tactibench import UserError


class Clock:
    """Seconds of the world since it was made; they pass ``scale`` times as fast as the host's."""

    def __init__(self, scale: float = 1.0) -> None:
        if not (math.isfinite(scale) and 0 < scale <= 1000):
            raise UserError(f"the time scale is {scale:g}; it must be above 0 and at most 1000.")
        self.scale = scale
        self._start = time.monotonic_ns()

    def now(self) -> float:
        """Seconds of the world, now."""
        return self.at(time.monotonic_ns())

    def at(self, monotonic_ns: int) -> float:
        """Seconds of the world at a reading of ``time.monotonic_ns``."""
        return (monotonic_ns - self._start) * 1e-9 * self.scale

    def host_seconds(self, seconds: float) -> float:
        """How long the host waits for seconds of the world."""
        return seconds / self.scale

    def sleep(self, seconds: float) -> None:
        """Sleep for seconds of the world."""
        time.sleep(self.host_seconds(seconds))
