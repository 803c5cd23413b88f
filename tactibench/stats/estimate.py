"""A value with its interval, as every interval function returns it."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """A value with its interval.

    value, low, high: None where there is nothing to estimate from; never NaN. n: values that were
    averaged. clusters: presses they come from. censored: "<" or ">" when the value is only known
    to lie beyond the one given.

    Raises ValueError when a number is not finite.
    """

    value: float | None
    low: float | None
    high: float | None
    n: int
    clusters: int
    censored: str | None = None

    def __post_init__(self) -> None:
        for name in ("value", "low", "high"):
            number = getattr(self, name)
            if number is not None and not math.isfinite(number):
                raise ValueError(f"the {name} of an estimate is {number}")

    @classmethod
    def nothing(cls) -> Estimate:
        """Return no value at all: shown as n/a."""
        return cls(None, None, None, 0, 0)
