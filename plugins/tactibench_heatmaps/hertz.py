"""The encoder ``hertz``: the depth-weighted Hertz-Gaussian heatmap and its decoders."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactibench import Contacts, Grid
from tactibench_heatmaps.encoder import MapEncoder, MapStack
from tactibench_heatmaps.kernel import Kernel
from tactibench_heatmaps.peaks import TOLERANCE, PeakReader, split


class HertzGaussian(MapEncoder):
    """Contacts <-> one map of Gaussians: height d / max_depth, sigma^2 = R d / 9 + blur^2.

    Parameters as declared in ``hooks``. Kernels combine by maximum and are never rounded to a cell.

    The decoders are those of ``peaks``: "maximum" as published, "least-squares", "wide" and
    "dark". For all but "maximum" a bump on the flank of a higher peak is no contact.

    The score of a contact is the heat of its peak, cut to 0..1: the deepest comes first.

    separation and tolerance, mm, hold for the default parameters on a 64 x 64 grid of 0.4 mm pitch
    and depths of 0.5 to 6 mm in any combination.
    """

    channels = 1

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
        self.kernel = Kernel(max_depth, radius, blur)
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
        self.separation = 8.0 if decoder == "dark" else 6.5
        self.tolerance = TOLERANCE[decoder]

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, 1, H, W) float32 maps. Raises UserError for a depth outside 0..max_depth."""
        return self.kernel.render(contacts, grid)[:, None]

    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        found = self.peaks.read(stack[:, 0], grid.pitch)
        row, column, heat = found.flat(found.place).T
        depth, score = heat * self.kernel.max_depth, np.minimum(heat, 1.0)
        return split(found.counts, grid.xy(row, column), depth, score)
