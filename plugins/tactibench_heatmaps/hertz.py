"""The encoder ``hertz``: the depth-weighted Hertz-Gaussian heatmap and its decoders.

Source: TactiVerse, "Data Preprocessing". A tip of radius R at depth d has the Hertz contact radius
a = sqrt(R d); the edge of the contact is taken as 3 sigma, so sigma_contact = a / 3, and the skin's
compliance widens it: sigma^2 = R d / 9 + sigma_blur^2. The height of the kernel is d / d_max.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactibench import Contacts, Grid
from tactibench_heatmaps.encoder import (
    TOLERANCE,
    MapEncoder,
    MapStack,
    PeakReader,
    relative_depth,
    split_contacts,
)

_BLOCK = 64
"""Maps rendered at a time, so that one block stays in the cache."""


class HertzGaussian(MapEncoder):
    """Contacts <-> one map of Gaussians: height d / max_depth, sigma^2 = R d / 9 + blur^2.

    The parameters are declared in ``hooks``. Kernels combine by maximum and are never rounded to a
    cell.

    The decoders are "maximum" as published, "least-squares" and "wide". For all but "maximum" a
    bump on the flank of a higher peak is no contact.

    The score of a contact is the heat of its peak, cut to 0..1: the deepest comes first.

    ``separation`` and ``tolerance`` hold for the default parameters on a 64 x 64 grid of 0.4 mm
    pitch and depths of 0.5 to 6 mm in any combination.
    """

    channels = 1
    separation = 6.5

    def __init__(
        self,
        *,
        max_depth: float = 6.0,
        radius: float = 3.0,
        blur: float = 2.0,
        decoder: str = "wide",
        threshold: float = 0.25 / 6.0,
        min_distance: float = 3.0,
        max_count: int = 6,
        window: int = 11,
        width: str = "kernel",
    ) -> None:
        self.max_depth = max_depth
        self.peaks = PeakReader(
            slope=radius * max_depth / 9.0,
            base=blur**2,
            decoder=decoder,
            threshold=threshold,
            min_distance=min_distance,
            max_count=max_count,
            window=window,
            free=width == "free",
            flanks=decoder != "maximum",
        )
        self.tolerance = TOLERANCE[decoder]

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, 1, H, W) float32 maps.

        Raises:
            UserError: A depth is not between 0 and ``max_depth``.
        """
        maps = np.zeros((len(contacts), 1, *grid.shape), dtype=np.float32)
        counts = np.fromiter((len(c) for c in contacts), dtype=np.intp, count=len(contacts))
        if not counts.any():
            return maps
        xy = np.concatenate([c.xy for c in contacts])
        heat = relative_depth(np.concatenate([c.depth for c in contacts]), self.max_depth)
        x, y = grid.axes()
        scale = (-0.5 / (self.peaks.slope * heat + self.peaks.base))[:, None]
        along_x = np.exp(scale * (x - xy[:, :1]) ** 2).astype(np.float32)
        along_y = (heat[:, None] * np.exp(scale * (y - xy[:, 1:]) ** 2)).astype(np.float32)
        first = np.cumsum(counts) - counts
        for start in range(0, len(maps), _BLOCK):
            block = np.arange(start, min(start + _BLOCK, len(maps)))
            for k in range(counts[block].max()):
                rows = block[counts[block] > k]
                contact = first[rows] + k
                kernels = along_y[contact, :, None] * along_x[contact, None, :]
                maps[rows, 0] = np.maximum(maps[rows, 0], kernels) if k else kernels
        return maps

    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        peaks = self.peaks.read(stack[:, 0], grid.pitch)
        row, column, heat = peaks.flat(peaks.place).T
        depth, score = heat * self.max_depth, np.minimum(heat, 1.0)
        return split_contacts(peaks.counts, grid.xy(row, column), depth, score)
