"""The depth-weighted Hertz-Gaussian kernel.

Source: TactiVerse, "Data Preprocessing". A tip of radius R at depth d has the Hertz contact radius
a = sqrt(R d); the edge of the contact is taken as 3 sigma, so sigma_contact = a / 3, and the skin's
compliance widens it: sigma^2 = R d / 9 + sigma_blur^2. The height of the kernel is d / d_max.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench import Contacts, Grid, UserError

FloatArray = npt.NDArray[np.float64]
_BLOCK = 64  # maps rendered at a time, so that one block stays in the cache


@dataclass(frozen=True)
class Kernel:
    """max_depth: depth of heat 1. radius: R. blur: sigma_blur. All mm."""

    max_depth: float = 6.0
    radius: float = 3.0
    blur: float = 2.0

    def variance(self, heat: FloatArray) -> FloatArray:
        """sigma^2 in mm^2 of kernels with the given peak heat."""
        return self.radius * self.max_depth / 9.0 * heat + self.blur**2

    def render(self, contacts: Sequence[Contacts], grid: Grid) -> npt.NDArray[np.float32]:
        """(N, H, W) maps; where kernels overlap the greatest counts. Nothing is rounded.

        Raises UserError when a contact is not between 0 and ``max_depth`` deep.
        """
        rows, columns = grid.shape
        out = np.zeros((len(contacts), rows, columns), dtype=np.float32)
        counts = np.fromiter((len(c) for c in contacts), dtype=np.intp, count=len(contacts))
        if not counts.any():
            return out
        xy = np.concatenate([c.xy for c in contacts])
        heat = relative_depth(np.concatenate([c.depth for c in contacts]), self.max_depth)
        x, y = grid.axes()
        scale = (-0.5 / self.variance(heat))[:, None]
        along_x = np.exp(scale * (x - xy[:, :1]) ** 2).astype(np.float32)
        along_y = (heat[:, None] * np.exp(scale * (y - xy[:, 1:]) ** 2)).astype(np.float32)
        first = np.cumsum(counts) - counts
        for start in range(0, len(out), _BLOCK):
            block = np.arange(start, min(start + _BLOCK, len(out)))
            for k in range(counts[block].max()):
                maps = block[counts[block] > k]
                which = first[maps] + k
                kernels = along_y[which, :, None] * along_x[which, None, :]
                out[maps] = np.maximum(out[maps], kernels) if k else kernels
        return out


def relative_depth(depth: FloatArray, max_depth: float) -> FloatArray:
    """Depth in units of ``max_depth``. Raises UserError for one that is not between 0 and it."""
    bad = (depth < 0) | (depth > max_depth + 1e-9)
    if bad.any():
        raise UserError(
            f"a contact is {depth[bad][0]:.4g} mm deep, but heatmaps hold 0 to "
            f"{max_depth:g} mm; raise the encoder's parameter 'max_depth'."
        )
    return np.minimum(depth / max_depth, 1.0)
