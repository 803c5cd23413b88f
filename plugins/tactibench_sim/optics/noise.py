"""Camera noise: its strength, and the stream of random numbers of every press."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # parameters are listed without numpy
    import numpy as np
    import numpy.typing as npt

    Grey = npt.NDArray[np.floating]

WHITE = 255
ROUNDING = 1 / 12
"""Variance of rounding to whole grey levels."""


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of variance read^2 + 255 / full_well * grey (EMVA 1288, its linear model).

    Attributes:
        on: False leaves the frame as it is.
        read: Read noise, grey levels, rms (assumed).
        full_well: Electrons at grey level 255 (10,000 is a common small CMOS pixel; assumed).
    """

    on: bool = True
    read: float = 1.5
    full_well: float = 10_000.0

    @property
    def shot(self) -> float:
        """Variance per grey level."""
        return WHITE / self.full_well

    def variance(self, clean: Grey) -> Grey:
        """Return the variance of pixels of the 8-bit frame, rounding included, grey levels squared.

        It is exact where the noise spans a grey level or more (read >= 0.7) and nothing is clipped
        at 0 or 255.
        """
        slope, floor = (self.shot, self.read**2) if self.on else (0.0, 0.0)
        return slope * clean + (floor + ROUNDING)


def streams(seed: np.random.SeedSequence, first: int, count: int) -> npt.NDArray[np.uint64]:
    """Return (count, 4) SFC64 states for the presses ``first``, ``first + 1``, ...

    a and b come from the seed, c is a bijection (splitmix64; Steele et al., OOPSLA 2014) of the
    seed's third word plus the press number, so that no two presses of a seed share a state; the
    kernel then stirs twelve rounds, as numpy's SFC64 does on seeding.
    """
    import numpy as np

    key = seed.generate_state(3, np.uint64)
    state = np.empty((count, 4), dtype=np.uint64)
    state[:, :2], state[:, 3] = key[:2], 1
    mixed = key[2] + np.arange(first, first + count, dtype=np.uint64) * np.uint64(_GOLDEN)
    for shift, factor in _MIX:
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    state[:, 2] = mixed ^ (mixed >> np.uint64(31))
    return state


_GOLDEN = 0x9E3779B97F4A7C15
_MIX = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB))


@cache
def normal_table() -> npt.NDArray[np.float32]:
    """Return 65,536 standard normal values, equally likely: a 16-bit word picks one.

    Entry k is the mean of the normal distribution between its quantiles k and k + 1 of 65,536,
    scaled to variance 1 (by 7e-7); excess kurtosis -2e-4, largest value 4.4.
    """
    import numpy as np
    from scipy.special import ndtri

    edges = ndtri(np.arange(65_537) / 65_536)
    density = np.exp(-(edges**2) / 2) / np.sqrt(2 * np.pi)
    values = (density[:-1] - density[1:]) * 65_536
    values = (values - values[::-1]) / 2
    table: npt.NDArray[np.float32] = (values / values.std()).astype(np.float32)
    table.setflags(write=False)
    return table
