"""Values that an emulated tool is watched for: the box it must stay in, a depth, a force."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench_tactip.emulators.motion import Array


@dataclass(frozen=True)
class Envelope:
    """A box of the work frame in which the tool point must stay, and its greatest tilt.

    It is written apart from the drivers' own check, so that one can find a mistake of the other.

    Attributes:
        x: Least and greatest x, mm.
        y: Least and greatest y, mm.
        z: Least and greatest z, mm.
        tilt: Greatest tilt against the work frame's z, deg.
        slack_mm: Distance outside the box that rounding may cause.
    """

    x: tuple[float, float] = (-20.0, 20.0)
    y: tuple[float, float] = (-20.0, 20.0)
    z: tuple[float, float] = (-60.0, 6.5)
    tilt: float = 45.0
    slack_mm: float = 1e-3

    def holds(self, poses: Array) -> npt.NDArray[np.bool_]:
        """Return (N,) whether each of the poses (N, 4, 4) in the work frame lies inside."""
        low, high = np.transpose([self.x, self.y, self.z])
        places = poses[:, :3, 3]
        inside = (places >= low - self.slack_mm) & (places <= high + self.slack_mm)
        upright = poses[:, 2, 2] >= math.cos(math.radians(self.tilt)) - 1e-6
        result: npt.NDArray[np.bool_] = inside.all(axis=1) & upright
        return result


@dataclass(frozen=True)
class Watch:
    """A callback for the moment at which the depth or the force passes a value.

    Attributes:
        quantity: "depth" or "force".
        value: Value to pass, mm or N.
        notify: Function that is called with the time of the world, s.
        falling: Whether the value is passed downwards.
    """

    quantity: str
    value: float
    notify: Callable[[float], None]
    falling: bool = False

    def crossing(self, times: Array, values: Array) -> float | None:
        """Return the first time at which values pass the level; None: they do not.

        Args:
            times: (N,) times, s.
            values: (N,) depths or forces at these times.
        """
        with np.errstate(invalid="ignore"):  # beside the dome the depth is minus infinity
            above = (values - self.value) * (-1.0 if self.falling else 1.0)
            passed = np.flatnonzero((above[1:] >= 0) & ~(above[:-1] >= 0))
        if not len(passed):
            return None
        k = int(passed[0])
        low, high = float(above[k]), float(above[k + 1])
        share = -low / (high - low) if math.isfinite(low) else 1.0
        return float(times[k] + share * (times[k + 1] - times[k]))
