"""Camera noise: shot and read noise, one independent stream for every press."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

GREY = 255
_ROUNDING = 1 / 12  # variance of rounding to whole grey levels


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of variance read^2 + 255 / full_well * grey.

    on: False leaves the frame as it is. read: grey levels, rms (assumed). full_well: electrons at
    grey level 255 (10,000 is a common small CMOS pixel; assumed).
    """

    on: bool = True
    read: float = 1.5
    full_well: float = 10_000.0

    def variance(self, clean: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
        """Variance of a pixel of the 8-bit frame, rounding included, grey levels squared."""
        return self._camera(clean) + _ROUNDING if self.on else np.full_like(clean, _ROUNDING)

    def _camera(self, clean: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
        return clean * (GREY / self.full_well) + self.read**2

    def expose(
        self, clean: npt.NDArray[np.float32], seed: np.random.SeedSequence, press: int
    ) -> npt.NDArray[np.uint8]:
        """The 8-bit frame of the press with that number: a stream of its own for every number."""
        if not self.on:
            return to_uint8(clean.copy())
        own = np.random.SeedSequence(
            seed.entropy, spawn_key=(*seed.spawn_key, press), pool_size=seed.pool_size
        )
        seen = np.random.Generator(np.random.SFC64(own)).standard_normal(
            clean.shape, dtype=np.float32
        )
        seen *= np.sqrt(self._camera(clean))
        seen += clean
        return to_uint8(seen)


def to_uint8(grey: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """Round and clip in place, then convert."""
    np.rint(grey, out=grey)
    np.clip(grey, 0, GREY, out=grey)
    return grey.astype(np.uint8)
